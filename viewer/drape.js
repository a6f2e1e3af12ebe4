/* One drape: its header, its arrays, its column on the page and its stage. */

class Drape {
  /**
   * A drape of the book, shown in a new column.
   *
   * @param book Header of the page, shared by all drapes.
   * @param view view(Type, index) gives an array of the payload.
   * @param index Number of the drape.
   */
  constructor(book, view, index) {
    this.plan = book.drapes[index];
    Object.assign(this, { book, view, index, letter: "AB"[index] ?? String(index + 1), pose: 0, home: null, tags: "landing" });
    this.dom = this.addColumn();
    const { pane } = this.dom, { plan } = this;
    const viewer = (this.viewer = new MeshCat.Viewer(pane));
    const resize = viewer.set_3d_pane_size.bind(viewer);
    viewer.set_3d_pane_size = () => resize(pane.clientWidth, pane.clientHeight);
    viewer.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    for (const blob of plan.commands) viewer.handle_command_bytearray(view(Uint8Array, blob));
    this.ply = new Ply(this);
    this.front = new Front(this, this.ply, 0.1 * plan.cups.radius);
    this.marks = new Marks(this);
    this.cups = new Cups(this);
    this.bodies = new Bodies(this);
    this.shown = [this.ply, this.front, this.marks, this.cups, this.bodies];
    lightStage(viewer, plan.boxes.drape);
    viewer.set_3d_pane_size();
    const render = viewer.render.bind(viewer);
    viewer.render = () => {
      this.clearAir();
      render();
      drawTags(this);
    };
  }

  /** The floor fades into the background, whatever the camera's distance. */
  clearAir() {
    if (!this.home) return;
    const away = this.viewer.camera.position.distanceTo(this.home.target), { fog } = this.viewer.scene;
    fog.near = away + 0.4 * this.home.size;
    fog.far = away + 1.8 * this.home.size;
  }

  /** Header and pane of the drape, from the page's template. */
  addColumn() {
    const { plan } = this, column = byId("column").content.cloneNode(true).firstElementChild;
    const find = (name) => column.querySelector(`.${name}`);
    const dom = { column, pane: find("pane"), tags: find("tags"), head: find("head"), now: find("now"), verdict: find("verdict") };
    find("title").textContent = this.book.drapes.length > 1 ? `${this.letter} · ${plan.title}` : plan.title;
    find("subtitle").textContent = plan.subtitle;
    find("answer").textContent = plan.verdict[0] ?? "";
    find("answer").classList.add(plan.good ? "good" : "bad");
    for (const sentence of plan.verdict.slice(1)) dom.verdict.append(element("li", sentence));
    column.querySelector("details").open = this.book.drapes.length === 1 && innerWidth >= 1000;
    column.setAttribute("aria-label", plan.title);
    byId("stages").append(column);
    return dom;
  }

  show(pose, palette) {
    this.pose = pose;
    for (const part of this.shown) part.show(pose, palette);
    this.dom.now.textContent = this.plan.labels[pose];
    this.dom.pane.setAttribute("aria-label", `${this.plan.title}: ${this.plan.labels[pose]}`);
    this.viewer.set_dirty();
  }

  /** Object of the scene that a switch shows and hides. */
  part(name) {
    const path = { Fibers: ["ply", "fibers"] }[name] ?? [name.toLowerCase()];
    return this.viewer.scene_tree.find(["meshcat", ...path]).object;
  }

  /** Place of a point, z up, in the pane, in pixels. */
  onScreen(point) {
    const place = yUp(point).project(this.viewer.camera), { clientWidth, clientHeight } = this.dom.pane;
    return [((place.x + 1) / 2) * clientWidth, ((1 - place.y) / 2) * clientHeight];
  }
}
