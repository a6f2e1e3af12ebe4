/* Cups with their names, legs and interlinks. */

class Cups {
  constructor(drape) {
    const T = MeshCat.THREE, { plan, view, viewer } = drape, { names, radius } = plan.cups;
    this.names = names;
    this.count = names.length;
    this.states = view(Uint8Array, plan.cups.states);
    this.tracks = {};
    this.at = {};
    for (const key of ["faces", "tops", "balls", "universals"]) {
      this.tracks[key] = new Track(plan.cups[key], view);
      this.at[key] = new Float32Array(3 * this.count);
    }
    this.colors = drape.book.states.map((state) => new T.Color(state.color));
    this.bodies = cylinders(this.count, radius, 0xffffff);
    this.legs = cylinders(this.count, 0.22 * radius, 0x8b949e);
    this.links = view(Uint32Array, plan.cups.interlinks);
    const shape = new T.BufferGeometry();
    this.ends = new T.BufferAttribute(new Float32Array(3 * this.links.length), 3);
    shape.setAttribute("position", this.ends);
    const lines = new T.LineSegments(shape, new T.LineBasicMaterial({ color: 0x4b5663, transparent: true, opacity: 0.8 }));
    lines.frustumCulled = false;
    viewer.set_object(["meshcat", "cups"], this.bodies);
    viewer.set_object(["meshcat", "tool", "legs"], this.legs);
    viewer.set_object(["meshcat", "interlinks"], lines);
  }

  /** State of cup i at pose k: an index into book.states. */
  state(k, i) { return this.states[k * this.count + i]; }

  /** How many cups are in each state at pose k. */
  counts(k) {
    const counts = this.colors.map(() => 0);
    for (let i = 0; i < this.count; i++) counts[this.state(k, i)]++;
    return counts;
  }

  show(k) {
    for (const key in this.tracks) this.tracks[key].read(k, this.at[key]);
    const { faces, tops, balls, universals } = this.at;
    for (let i = 0; i < this.count; i++) {
      stretch(this.bodies, i, pointOf(faces, i), pointOf(tops, i), this.state(k, i) === 1 ? 1.25 : 1);
      stretch(this.legs, i, pointOf(balls, i), pointOf(universals, i));
      this.bodies.setColorAt(i, this.colors[this.state(k, i)]);
    }
    this.links.forEach((cup, end) => { for (let c = 0; c < 3; c++) this.ends.array[3 * end + c] = balls[3 * cup + c]; });
    for (const changed of [this.bodies.instanceMatrix, this.bodies.instanceColor, this.legs.instanceMatrix, this.ends])
      changed.needsUpdate = true;
  }
}

/** A label above a place of the pane, higher where one of `taken` is in its way. */
function drawLabel(ink, [left, top], text, paper, color, taken = []) {
  const wide = ink.measureText(text).width + 8;
  const hit = () => taken.some((other) => 2 * Math.abs(other.left - left) < other.wide + wide && Math.abs(other.top - top) < 16);
  while (hit()) top -= 4;
  taken.push({ left, top, wide });
  ink.fillStyle = paper;
  ink.fillRect(left - wide / 2, top - 22, wide, 15);
  ink.fillStyle = color;
  ink.fillText(text, left, top - 14);
}

/** Names at the cups, "landing" of those that land, "all" of every cup, and the marks'. */
function drawTags(drape) {
  const { cups, marks, pose, book, tags: mode } = drape, canvas = drape.dom.tags, ink = canvas.getContext("2d");
  canvas.width = canvas.clientWidth * devicePixelRatio;
  canvas.height = canvas.clientHeight * devicePixelRatio;
  ink.scale(devicePixelRatio, devicePixelRatio);
  ink.textAlign = "center";
  ink.textBaseline = "middle";
  ink.font = "600 11px system-ui, 'DejaVu Sans', sans-serif";
  for (let i = 0; i < cups.count && drape.part("Cups").visible; i++) {
    const state = book.states[cups.state(pose, i)], landing = state === book.states[1];
    if (mode === "off" || (mode === "landing" && !landing)) continue;
    const place = drape.onScreen(pointOf(cups.at.tops, i)), text = `${state.symbol} ${cups.names[i]}`;
    drawLabel(ink, place, text, landing ? state.color : "rgba(255, 255, 255, 0.8)", landing ? "#fff" : "#1d2733");
  }
  if (!drape.part("Marks").visible) return;
  const taken = [];
  for (const { text, point, color } of marks.labels()) {
    const [left, top] = drape.onScreen(point);
    ink.strokeStyle = color;
    ink.lineWidth = 2;
    ink.beginPath();
    ink.arc(left, top, 7, 0, 7);
    ink.stroke();
    drawLabel(ink, [left, top - 4], text, "#1d2733", "#fff", taken);
  }
}
