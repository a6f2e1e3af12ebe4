/* Asked by picture.py, not part of the page. */

/** What the page says of itself once it is ready: "yes" or "failed". */
function whenReady() {
  return new Promise((done) => {
    const look = () => document.body?.dataset.ready ? done(document.body.dataset.ready) : setTimeout(look, 20);
    look();
  });
}

/** Wait until what has changed is laid out and drawn. */
function drawn() {
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
}

/** Dress the page for a picture: on white paper, nothing to press, title and label aside. */
function prepare(css) {
  const free = freeInsets;
  window.freeInsets = (pane) => ({ ...free(pane, element("div")), top: 16, bottom: 16 });
  document.head.append(element("style", css));
  for (const drape of app.drapes) {
    const { viewer } = drape;
    drape.tags = "off"; // colors say what cups do, and names cover what is to be seen
    viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.castShadow = true; // however slow
    viewer.scene.background = new MeshCat.THREE.Color(0xffffff);
    drape.dom.head.querySelector("details").open = false;
  }
  return drawn();
}

/** Show a moment from a camera preset. */
function visit(moment, camera) {
  app.look(camera ?? app.view);
  for (const { viewer } of app.drapes)
    for (const name of ["floor", "table"]) viewer.scene_tree.find(["meshcat", name]).object.visible = app.view === "Cell";
  app.show(moment);
  return drawn();
}
