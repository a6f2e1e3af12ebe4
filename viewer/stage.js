/* What moves: ply, cups, legs, interlinks, arm and platform, drawn by meshcat's three.js. */

/** Shadows fall from the ply alone, and never on it: its colors mean the gap. */
function lightStage(viewer, box) {
  const T = MeshCat.THREE, node = viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]);
  const light = node.object, middle = box[0].map((low, i) => (low + box[1][i]) / 2);
  const size = Math.hypot(...box[0].map((low, i) => box[1][i] - low));
  light.position.set(middle[0] + 0.7 * size, middle[1] - 0.9 * size, middle[2] + 1.8 * size);
  light.angle = 0.9;
  light.penumbra = 1;
  light.castShadow = true;
  light.shadow.mapSize.set(2048, 2048);
  light.shadow.bias = -4e-4;
  light.shadow.normalBias = 0.003 * size;
  light.shadow.radius = 3;
  light.shadow.camera.near = 0.5 * size;
  light.shadow.camera.far = 5 * size;
  light.target = new T.Object3D();
  light.target.position.set(...middle);
  viewer.scene.add(light.target);
  viewer.scene_tree.find(["meshcat"]).object.traverse((o) => { o.castShadow = false; });
}

/** A cylinder of unit height for each of `count` places, colored one by one. */
function cylinders(count, radius, color) {
  const T = MeshCat.THREE, shape = new T.CylinderGeometry(radius, radius, 1, 24);
  const mesh = new T.InstancedMesh(shape, new T.MeshLambertMaterial({ color }), count);
  mesh.instanceMatrix.setUsage(T.DynamicDrawUsage);
  mesh.frustumCulled = false;
  return mesh;
}

/** Stretch cylinder i from one end to the other; both are offsets into flat arrays. */
const stretch = (() => {
  const T = MeshCat.THREE, up = new T.Vector3(0, 1, 0), along = new T.Vector3();
  const middle = new T.Vector3(), scale = new T.Vector3(1, 1, 1);
  const turn = new T.Quaternion(), matrix = new T.Matrix4();
  return (mesh, i, from, to, thick = 1) => {
    along.set(to[3 * i] - from[3 * i], to[3 * i + 1] - from[3 * i + 1], to[3 * i + 2] - from[3 * i + 2]);
    middle.fromArray(from, 3 * i).addScaledVector(along, 0.5);
    const length = Math.max(along.length(), 1e-9);
    turn.setFromUnitVectors(up, along.divideScalar(length));
    mesh.setMatrixAt(i, matrix.compose(middle, turn, scale.set(thick, length, thick)));
  };
})();

/** The ply: a mesh colored by the gap and some of its fibers, on the same points. */
class Ply {
  constructor(viewer, plan, view) {
    const T = MeshCat.THREE;
    this.track = new Track(plan.ply, view);
    const { poses, rows, columns } = plan.ply;
    this.gap = unfold(view(Uint8Array, plan.gap), Uint8Array, 1, poses, rows, columns);
    this.palette = view(Uint8Array, plan.palette);
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

  show(k) {
    this.track.read(k, this.points.array);
    const { gap, palette } = this, color = this.colors.array, n = this.track.count;
    for (let i = 0; i < n; i++)
      for (let c = 0; c < 3; c++) color[3 * i + c] = palette[3 * gap[k * n + i] + c] / 255;
    this.points.needsUpdate = this.colors.needsUpdate = true;
    this.shape.computeVertexNormals();
    this.shape.computeBoundingSphere();
  }
}

/** Cups, legs and interlinks. */
class Cups {
  constructor(viewer, plan, view) {
    const T = MeshCat.THREE, { names, radius } = plan.cups;
    this.names = names;
    this.count = names.length;
    this.states = view(Uint8Array, plan.cups.states);
    this.tracks = {};
    this.at = {};
    for (const key of ["faces", "tops", "balls", "universals"]) {
      this.tracks[key] = new Track(plan.cups[key], view);
      this.at[key] = new Float32Array(3 * this.count);
    }
    this.colors = plan.states.map((state) => new T.Color(state.color));
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
    viewer.set_object(["meshcat", "tool", "interlinks"], lines);
  }

  state(k, i) { return this.states[k * this.count + i]; }

  show(k) {
    for (const key in this.tracks) this.tracks[key].read(k, this.at[key]);
    const { faces, tops, balls, universals } = this.at;
    for (let i = 0; i < this.count; i++) {
      stretch(this.bodies, i, faces, tops, this.state(k, i) === 1 ? 1.25 : 1);
      stretch(this.legs, i, balls, universals);
      this.bodies.setColorAt(i, this.colors[this.state(k, i)]);
    }
    this.links.forEach((cup, end) => { for (let c = 0; c < 3; c++) this.ends.array[3 * end + c] = balls[3 * cup + c]; });
    for (const changed of [this.bodies.instanceMatrix, this.bodies.instanceColor, this.legs.instanceMatrix, this.ends])
      changed.needsUpdate = true;
  }
}

/** Bodies that keep their shape: arm and platform, one matrix a pose. */
class Bodies {
  constructor(viewer, plan, view) {
    const arm = view(Float32Array, plan.arm), poses = plan.labels.length;
    const tree = viewer.scene_tree;
    this.moving = [{ object: tree.find(["meshcat", "tool", "platform"]).object, matrices: view(Float32Array, plan.tool) }];
    for (let body = 0; body * 16 * poses < arm.length; body++)
      this.moving.push({ object: tree.find(["meshcat", "arm", String(body)]).object,
        matrices: arm.subarray(body * 16 * poses, (body + 1) * 16 * poses) });
    this.matrix = new MeshCat.THREE.Matrix4();
  }

  show(k) {
    for (const { object, matrices } of this.moving)
      this.matrix.fromArray(matrices, 16 * k).decompose(object.position, object.quaternion, object.scale);
  }
}
