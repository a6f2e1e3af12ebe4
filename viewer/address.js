/* The address: #step=21&cam=Top names the end of a wave step, #pose=87 any moment. */

/** Keep the address and what is shown the same, both ways. */
function addAddress(app) {
  let writing = null;
  const write = () => {
    const { step } = app.moment, ended = step >= 0 && app.timeline.endOf(step) === app.pose;
    const when = ended ? `step=${step}` : `pose=${app.pose + 1}`;
    history.replaceState(null, "", `#${when}&cam=${app.view}`);
  };
  const later = () => { // browsers refuse many changes a second
    clearTimeout(writing);
    writing = setTimeout(write, 150);
  };
  const read = () => {
    const wanted = new URLSearchParams(location.hash.slice(1));
    if (wanted.has("cam")) app.look(wanted.get("cam"));
    const end = wanted.has("step") ? app.timeline.endOf(parseInt(wanted.get("step"), 10)) : null;
    const pose = parseInt(wanted.get("pose"), 10) - 1;
    if (end !== null) app.timeline.jump(end);
    else if (Number.isFinite(pose)) app.timeline.jump(pose);
  };
  read();
  app.onPose(later);
  app.onLook(later);
  addEventListener("hashchange", () => { clearTimeout(writing); read(); later(); });
}
