/* Asked by picture.py, not part of the page. */

/** What the page says of itself once it is ready: "yes" or "failed". */
function whenReady() {
  return new Promise((done) => {
    const look = () => document.body?.dataset.ready ? done(document.body.dataset.ready) : setTimeout(look, 20);
    look();
  });
}

/** Dress the page for a picture; shadows fall however slowly it draws. */
function prepare(css) {
  document.head.append(element("style", css));
  for (const { viewer, dom } of app.drapes) {
    viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.castShadow = true;
    dom.head.querySelector("details").open = false;
  }
}

/** Show a moment from a camera preset and wait until it is drawn. */
function visit(moment, camera) {
  app.look(camera ?? app.view);
  app.show(moment);
  return new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));
}
