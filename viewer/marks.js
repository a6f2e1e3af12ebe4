/* Marks: what goes wrong, where and when: regions of the ply, and fibers of a wrong length. */

const KINDS = {
  premature_contact: { name: "Premature contact", symbol: "▲", color: "#D55E00" },
  air_pocket: { name: "Air pocket", symbol: "◉", color: "#E69F00" },
  penetration: { name: "Penetration", symbol: "▼", color: "#FF00FF" },
  pad_penetration: { name: "Pad penetrates", symbol: "▽", color: "#FF00FF" },
  tight_fiber: { name: "Fiber too short", symbol: "↔", color: "#E8432E" },
  slack_fiber: { name: "Fiber too long", symbol: "∿", color: "#E8432E" },
};
const MOST_LABELS = 3; // of each kind at a pose: more would cover one another

/** Everything wrong of a drape as marks: kind, poses, samples, where its label stands, size. */
function marksOf({ plan, view }) {
  const samples = (blob) => Array.from(view(Uint32Array, blob)), { material, events, long_fibers } = plan.details;
  const nearest = (values, at) => values.reduce((best, value, i) => (Math.abs(value - at) < Math.abs(values[best] - at) ? i : best), 0);
  const at = ([s, t]) => nearest(material.t, t) * plan.ply.columns + nearest(material.s, s);
  const wrong = events.map((event) => ({
    kind: event.kind, poses: [event.pose], samples: samples(event.samples), at: at(event.place), size: event.area,
    text: event.on_way ? "on the way here" : event.kind === "premature_contact" ? `${(1e4 * event.area).toFixed(0)} cm²` : millimeters(event.depth) }));
  const fibers = long_fibers.map((fiber) => {
    const line = samples(fiber.samples), size = Math.max(fiber.need, fiber.surplus);
    return { kind: fiber.need > 0 ? "tight_fiber" : "slack_fiber", poses: samples(fiber.poses), line, size,
      at: line[line.length >> 1], text: millimeters(size, 2) };
  });
  return [...wrong, ...fibers];
}

class Marks {
  constructor(drape) {
    const T = MeshCat.THREE, { ply, plan, viewer } = drape;
    Object.assign(this, { ply, all: marksOf(drape), now: [] });
    this.index = ply.shape.index.array;
    this.regions = {};
    for (const kind of Object.keys(KINDS).slice(0, 4)) {
      const shape = new T.BufferGeometry();
      shape.setAttribute("position", ply.points);
      const mesh = new T.Mesh(shape, new T.MeshBasicMaterial({ color: KINDS[kind].color, side: T.DoubleSide,
        transparent: true, opacity: 0.7, polygonOffset: true, polygonOffsetFactor: -1, polygonOffsetUnits: -2 }));
      mesh.frustumCulled = false;
      this.regions[kind] = mesh;
      viewer.set_object(["meshcat", "marks", kind], mesh);
    }
    const pieces = this.all.reduce((sum, { line = [] }) => sum + Math.max(0, line.length - 1), 0);
    this.fibers = cylinders(pieces, 0.2 * plan.cups.radius, 0, new T.MeshBasicMaterial({ color: KINDS.slack_fiber.color }), 6);
    viewer.set_object(["meshcat", "marks", "fibers"], this.fibers);
  }

  show(k) {
    this.now = this.all.filter(({ poses }) => poses.includes(k)).sort((a, b) => b.size - a.size);
    for (const [kind, mesh] of Object.entries(this.regions)) {
      const inside = new Set(this.now.filter((mark) => mark.kind === kind).flatMap(({ samples }) => samples)), faces = [];
      for (let i = 0; inside.size && i < this.index.length; i += 3)
        if (inside.has(this.index[i]) || inside.has(this.index[i + 1]) || inside.has(this.index[i + 2]))
          faces.push(this.index[i], this.index[i + 1], this.index[i + 2]);
      mesh.visible = faces.length > 0;
      mesh.geometry.setIndex(faces);
    }
    const points = this.ply.points.array;
    let piece = 0;
    for (const { line = [] } of this.now)
      for (let i = 1; i < line.length; i++)
        stretch(this.fibers, piece++, pointOf(points, line[i - 1]), pointOf(points, line[i]));
    this.fibers.count = piece;
    this.fibers.instanceMatrix.needsUpdate = true;
  }

  /** How many marks of a kind there are at this pose. */
  count(kind) { return this.now.filter((mark) => mark.kind === kind).length; }

  /** Labels to write: text, color and the point each speaks of. */
  labels() {
    const told = {}, points = this.ply.points.array;
    return this.now.filter(({ kind }) => (told[kind] = (told[kind] ?? 0) + 1) <= MOST_LABELS).map(({ kind, text, at }) => ({
      text: `${KINDS[kind].symbol} ${KINDS[kind].name.toLowerCase()}, ${text}`, color: KINDS[kind].color,
      point: pointOf(points, at) }));
  }
}
