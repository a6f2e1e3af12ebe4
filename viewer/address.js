/* The address: #step=21&cam=Top names the end of a wave step, #pose=87 any moment. */

/** Keep the address and what is shown the same, both ways. */
function addAddress(app) {
  let writing = null, known = location.hash;
  const write = () => {
    if (location.hash !== known) return; // the reader's own, about to be read
    const { step } = app.moment, ended = step >= 0 && app.timeline.endOf(step) === app.pose;
    const when = ended ? `step=${step}` : `pose=${app.pose + 1}`;
    history.replaceState(null, "", `#${when}&cam=${app.view}`);
    known = location.hash;
  };
  const later = () => { // browsers refuse many changes a second
    clearTimeout(writing);
    writing = setTimeout(write, 150);
  };
  const read = () => {
    known = location.hash;
    const wanted = new URLSearchParams(known.slice(1)), end = app.timeline.endOf(parseInt(wanted.get("step"), 10));
    const pose = parseInt(wanted.get("pose"), 10) - 1;
    if (wanted.has("cam")) app.look(wanted.get("cam"));
    if (end !== null) app.timeline.jump(end);
    else if (Number.isFinite(pose)) app.timeline.jump(pose);
    later();
  };
  app.onPose(later);
  app.onLook(later);
  addEventListener("hashchange", read);
  read();
}
