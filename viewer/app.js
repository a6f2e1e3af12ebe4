/*
 * The page as one object, `app`. It shows one drape or more on one time line.
 *
 *   app.book               header of the page: drapes, moments, palettes, states, views, limits
 *   app.drapes[i]          plan (header of that drape), view(Type, blob) for its arrays, pose,
 *                          viewer (meshcat's), ply, cups, dom {column, pane, head, now, verdict}, letter
 *   app.pose               the moment shown: with one drape its pose, with more a place on the
 *                          time line that they share (drape.pose is each one's own)
 *   app.moment             what the time line says of it: phase, step (0 the start cup, -1 none),
 *                          tau, poses
 *   app.timeline           moments, runs (of one phase and step), jump(moment), play(on), endOf(step)
 *   app.show(moment)       show it; app.showPose(drape, pose) the moment of a drape's own pose
 *   app.onPose(fn)         fn(moment) after each change, and once now
 *   app.onLook(fn)         fn(name) after the view has changed
 *   app.onHover(fn)        fn(drape, sample): sample is {index, row, column, point, x, y} or null
 *   app.onClick(fn)        the same for a click on the ply
 *   app.probe              (drape, sample) => text or lines beside the pointer; may be replaced
 *   app.focus(drape, p)    bring the point p of the world, z up, in meters, into the middle
 *   app.look(name)         camera preset; app.switches[name].set(on) shows a part
 *   app.addPanel(name, element, options)
 *                          a panel with a toggle and a label for screen readers; options:
 *                          place "side" (default, right column) or "wide" (above the slider),
 *                          open (false), label (a longer name); returns {element, toggle}
 *
 * A panel's script pushes a function to `extensions`, which is called with the app before the
 * first picture; what it needs from a plan is put into the header by details.py and found under
 * drape.plan.details. page.py lists the scripts.
 */

const extensions = [];

class App {
  constructor(book, view) {
    Object.assign(this, { book, pose: 0, view: null, palette: null });
    this.listeners = { pose: [], look: [], hover: [], click: [] };
    document.title = book.drapes.map(({ title }) => title).join(" | ");
    document.body.dataset.drapes = book.drapes.length;
    this.drapes = book.drapes.map((_, index) => new Drape(book, view, index));
    this.palettes = Object.fromEntries(Object.entries(book.palettes).map(([name, blob]) => [name, view(Uint8Array, blob)]));
    this.legend = new Legend(this, (name) => this.paint(name));
    this.timeline = new Timeline(book.moments, (moment) => this.show(moment));
    this.probe = gapText;
    this.addSwitches();
    this.addViews();
    this.shareCamera();
    addKeys(this);
    watchPointer(this);
    for (const add of extensions) add(this);
    this.paint(Object.keys(this.palettes)[0]);
    this.look(book.drapes[0].opening);
    addAddress(this);
    this.watchSize();
  }

  get moment() { return this.book.moments[this.pose]; }

  onPose(fn) { this.listeners.pose.push(fn); fn(this.pose); }
  onLook(fn) { this.listeners.look.push(fn); }
  onHover(fn) { this.listeners.hover.push(fn); }
  onClick(fn) { this.listeners.click.push(fn); }
  hover(drape, sample) { for (const fn of this.listeners.hover) fn(drape, sample); }
  click(drape, sample) { for (const fn of this.listeners.click) fn(drape, sample); }

  show(moment) {
    const { timeline, drapes } = this, k = Math.max(0, Math.min(timeline.last, Math.round(moment) || 0));
    this.pose = k;
    drapes.forEach((drape, i) => drape.show(this.moment.poses[i], this.colors));
    this.legend.show();
    timeline.mark(k, `${k + 1} of ${timeline.last + 1} · ${this.label()}`);
    for (const fn of this.listeners.pose) fn(k);
  }

  showPose(drape, pose) {
    const found = this.book.moments.findIndex(({ poses }) => poses[drape.index] >= pose);
    this.timeline.jump(found < 0 ? this.timeline.last : found);
  }

  /** What happens now; where drapes differ each says it below its own title. */
  label() {
    const [first, ...others] = this.drapes.map(({ plan, pose }) => plan.labels[pose]), { phase, step } = this.moment;
    if (others.every((text) => text === first)) return first;
    return step > 0 ? `Wave step ${step}` : phase[0].toUpperCase() + phase.slice(1);
  }

  look(name) {
    const preset = this.book.views.find((item) => item.name === name);
    if (!preset) return;
    if (this.view !== name)
      for (const [part, { set }] of Object.entries(this.switches)) set(!preset.hide.includes(part));
    this.view = name;
    for (const drape of this.drapes) placeCamera(drape, preset);
    for (const button of byId("views").children) button.setAttribute("aria-pressed", String(button.textContent === name));
    for (const fn of this.listeners.look) fn(name);
  }

  focus(drape, point) {
    approach(drape, point);
    if (this.together) for (const other of this.drapes) if (other !== drape) followCamera(drape, other);
  }

  paint(name) {
    const bytes = this.palettes[name];
    this.palette = byId("palette").value = name;
    this.colors = Float32Array.from(bytes, (value) => value / 255);
    this.legend.paint(bytes);
    this.show(this.pose);
  }

  nextPalette() {
    const names = Object.keys(this.palettes);
    this.paint(names[(names.indexOf(this.palette) + 1) % names.length]);
  }

  addPanel(name, content, { place = "side", open = false, label = name } = {}) {
    const holder = element("section", "", { class: "panel-body", "aria-label": label });
    holder.append(content);
    byId(place).append(holder);
    const button = toggle(name, (on) => {
      holder.hidden = !on;
      if (on) holder.scrollIntoView({ block: "nearest" });
    }, { title: label });
    button.set(open);
    byId("panels").append(button);
    return { element: holder, toggle: button };
  }

  /** Toggles for the parts of the scene, in all drapes at once. */
  addSwitches() {
    this.switches = {};
    for (const name of this.book.parts) {
      const row = element("label", "", {}), box = element("input", "", { type: "checkbox" });
      const set = (on) => {
        box.checked = on;
        for (const drape of this.drapes) {
          drape.part(name).visible = on;
          drape.viewer.set_dirty();
        }
      };
      box.onchange = () => set(box.checked);
      row.append(box, name);
      byId("parts").append(row);
      this.switches[name] = { set };
      set(true);
    }
    byId("names").onchange = () => {
      for (const drape of this.drapes) {
        drape.tags = byId("names").value;
        drape.viewer.set_dirty();
      }
    };
  }

  /** When window or time line change their size, the drapes are framed anew. */
  watchSize() {
    const foot = byId("foot"), frame = () => {
      document.documentElement.style.setProperty("--foot", `${foot.offsetHeight}px`);
      for (const { viewer } of this.drapes) viewer.set_3d_pane_size();
      this.look(this.view);
    };
    new ResizeObserver(frame).observe(foot);
    addEventListener("resize", frame);
  }

  addViews() {
    for (const { name } of this.book.views) {
      const button = element("button", name, { type: "button" });
      button.onclick = () => this.look(name);
      byId("views").append(button);
    }
    byId("about").onclick = () => {
      byId("licenses-text").textContent = byId("notices").textContent;
      byId("licenses").showModal();
    };
    for (const close of document.querySelectorAll("dialog .close")) close.onclick = () => close.closest("dialog").close();
  }

  /** Cameras move together, until the reader wants them apart. */
  shareCamera() {
    this.together = this.drapes.length > 1;
    if (!this.together) return;
    let leading = false;
    for (const drape of this.drapes)
      drape.viewer.controls.addEventListener("change", () => {
        if (leading || !this.together || !drape.home) return;
        leading = true;
        for (const other of this.drapes) if (other !== drape && other.home) followCamera(drape, other);
        leading = false;
      });
    const button = toggle("Cameras together", (on) => { this.together = on; }, { id: "together" });
    button.set(true);
    byId("views").after(button);
  }
}
