/* The ply: a mesh colored by the gap, some of its fibers, and the front of contact. */

class Ply {
  constructor(drape) {
    const T = MeshCat.THREE, { plan, view, viewer } = drape;
    this.track = new Track(plan.ply, view);
    const { poses, rows, columns } = plan.ply;
    this.gap = unfold(view(Uint8Array, plan.gap), Uint8Array, 1, poses, rows, columns);
    const attribute = () => new T.BufferAttribute(new Float32Array(3 * this.track.count), 3).setUsage(T.DynamicDrawUsage);
    this.points = attribute();
    this.colors = attribute();
    const index = (blob) => new T.BufferAttribute(view(Uint32Array, blob).slice(), 1);
    this.shape = new T.BufferGeometry();
    this.shape.setAttribute("position", this.points);
    this.shape.setAttribute("color", this.colors);
    this.shape.setIndex(index(plan.triangles));
    this.mesh = new T.Mesh(this.shape, new T.MeshPhongMaterial({
      vertexColors: true, side: T.DoubleSide, shininess: 5, specular: 0x060606,
      polygonOffset: true, polygonOffsetFactor: 0.5, polygonOffsetUnits: 1 }));
    this.mesh.castShadow = true;
    const threads = new T.BufferGeometry();
    threads.setAttribute("position", this.points);
    threads.setIndex(index(plan.fibers));
    const lines = new T.LineSegments(threads, new T.LineBasicMaterial({ color: 0x8a8a8a, transparent: true, opacity: 0.55 }));
    this.mesh.frustumCulled = lines.frustumCulled = false;
    viewer.set_object(["meshcat", "ply", "surface"], this.mesh);
    viewer.set_object(["meshcat", "ply", "fibers"], lines);
  }

  /** Levels of the packed gap at pose k, one for each sample, in row-major order. */
  levels(k) { return this.gap.subarray(k * this.track.count, (k + 1) * this.track.count); }

  /** Show pose k in the colors of a palette: three numbers from 0 to 1 for each level. */
  show(k, palette) {
    this.track.read(k, this.points.array);
    const levels = this.levels(k), color = this.colors.array;
    for (let i = 0, at = 0; i < levels.length; i++) {
      const entry = 3 * levels[i];
      color[at++] = palette[entry];
      color[at++] = palette[entry + 1];
      color[at++] = palette[entry + 2];
    }
    this.points.needsUpdate = this.colors.needsUpdate = true;
    this.shape.computeVertexNormals();
    this.shape.computeBoundingSphere();
  }
}

/**
 * Where a field on a grid crosses a level: marching squares.
 * Returns flat quadruples (a, b, c, d, share, share): each end of a segment lies on an
 * edge between two samples, from a to b and from c to d, at its share of the way.
 */
function crossings(values, rows, columns, level) {
  const found = [], above = (i) => values[i] > level;
  const share = (a, b) => (level - values[a]) / (values[b] - values[a]);
  for (let row = 0; row + 1 < rows; row++)
    for (let column = 0; column + 1 < columns; column++) {
      const first = row * columns + column;
      const corners = [first, first + 1, first + columns + 1, first + columns];
      const ends = [];
      for (let side = 0; side < 4; side++) {
        const a = corners[side], b = corners[(side + 1) % 4];
        if (above(a) !== above(b)) ends.push([a, b]);
      }
      for (let end = 0; end + 1 < ends.length; end += 2) {
        const [[a, b], [c, d]] = [ends[end], ends[end + 1]];
        found.push([a, b, share(a, b), c, d, share(c, d)]);
      }
    }
  return found;
}

/** The front: a line on the ply where its height above how it will lie passes that of touch. */
class Front {
  constructor(drape, ply, radius) {
    Object.assign(this, { ply, radius, level: (254 * drape.plan.touch) / drape.book.gap_shown });
    const { rows, columns } = drape.plan.ply, T = MeshCat.THREE;
    this.size = [rows, columns];
    this.laid = ply.levels(drape.plan.ply.poses - 1);
    this.heights = new Int16Array(rows * columns);
    this.most = 4 * (rows + columns);
    this.mesh = cylinders(this.most, radius, 0xffffff, new T.MeshBasicMaterial({ color: 0xffffff }), 6);
    this.ends = [new Float32Array(3), new Float32Array(3)];
    drape.viewer.set_object(["meshcat", "front"], this.mesh);
  }

  show(k) {
    const { heights, laid, ply } = this, levels = ply.levels(k), points = ply.points.array;
    for (let i = 0; i < levels.length; i++) heights[i] = levels[i] - laid[i];
    const found = crossings(heights, ...this.size, this.level);
    const count = Math.min(found.length, this.most);
    const between = (out, a, b, share) => {
      for (let c = 0; c < 3; c++) out[c] = points[3 * a + c] + share * (points[3 * b + c] - points[3 * a + c]);
      return out;
    };
    for (let i = 0; i < count; i++) {
      const [a, b, near, c, d, far] = found[i];
      stretch(this.mesh, i, between(this.ends[0], a, b, near), between(this.ends[1], c, d, far));
    }
    this.mesh.count = count;
    this.mesh.instanceMatrix.needsUpdate = true;
  }
}
