/* What lies under the pointer: a sample of the ply, found by a ray. */

/** The sample of a drape's ply nearest to a place in the window, or null. */
function sampleAt(drape, x, y) {
  const T = MeshCat.THREE, ray = new T.Raycaster(), box = drape.dom.pane.getBoundingClientRect();
  const place = new T.Vector2((2 * (x - box.left)) / box.width - 1, 1 - (2 * (y - box.top)) / box.height);
  ray.setFromCamera(place, drape.viewer.camera);
  const [hit] = ray.intersectObject(drape.ply.mesh);
  if (!hit || !drape.part("Ply").visible) return null;
  const at = drape.ply.mesh.worldToLocal(hit.point.clone()), points = drape.ply.points.array;
  const away = (i) => Math.hypot(...[at.x, at.y, at.z].map((value, c) => value - points[3 * i + c]));
  const [index] = [hit.face.a, hit.face.b, hit.face.c].sort((a, b) => away(a) - away(b));
  const { columns } = drape.plan.ply;
  const point = [...points.subarray(3 * index, 3 * index + 3)];
  return { index, row: Math.floor(index / columns), column: index % columns, point, x, y };
}

/** Gap at a sample, as a text. */
function gapText(drape, sample) {
  const { gap_shown } = drape.book, { penetration } = drape.plan, level = drape.ply.levels(drape.pose)[sample.index];
  if (level === 0) return `penetrates more than ${millimeters(penetration)}`;
  return level === 255 ? `gap ≥ ${millimeters(gap_shown, 0)}` : `gap ${millimeters((gap_shown * (level - 1)) / 254)}`;
}

/** Tell the app what the pointer is over, at most once a frame, and what is clicked. */
function watchPointer(app) {
  for (const drape of app.drapes) {
    const { pane } = drape.dom;
    let waiting = false, pressed = null;
    pane.addEventListener("pointerleave", () => app.hover(drape, null));
    pane.addEventListener("pointermove", (event) => {
      if (event.buttons) return app.hover(drape, null);
      if (waiting) return;
      waiting = true;
      requestAnimationFrame(() => {
        waiting = false;
        app.hover(drape, sampleAt(drape, event.clientX, event.clientY));
      });
    });
    pane.addEventListener("pointerdown", (event) => { pressed = [event.clientX, event.clientY]; });
    pane.addEventListener("click", ({ clientX, clientY }) => {
      const still = pressed && Math.hypot(clientX - pressed[0], clientY - pressed[1]) < 4;
      const sample = still ? sampleAt(drape, clientX, clientY) : null;
      if (sample) app.click(drape, sample);
    });
  }
  const tip = byId("tip");
  app.onHover((drape, sample) => {
    tip.hidden = !sample;
    if (!sample) return;
    tip.replaceChildren(...[app.probe(drape, sample)].flat().map((line) => element("div", line)));
    tip.style.left = `${Math.max(4, Math.min(sample.x + 14, innerWidth - tip.offsetWidth - 4))}px`;
    tip.style.top = `${Math.min(sample.y + 14, innerHeight - tip.offsetHeight - 4)}px`;
  });
}
