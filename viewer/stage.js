/* The stage: light, bodies that keep their shape, and cylinders, drawn by meshcat's three.js. */

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
  viewer.scene.fog = new T.Fog(0xf2f4f6);
  viewer.scene_tree.find(["meshcat"]).object.traverse((o) => { o.castShadow = false; });
}

/** A cylinder of unit height for each of `count` places, colored one by one. */
function cylinders(count, radius, color, material = null, sides = 24) {
  const T = MeshCat.THREE, shape = new T.CylinderGeometry(radius, radius, 1, sides);
  const mesh = new T.InstancedMesh(shape, material ?? new T.MeshLambertMaterial({ color }), count);
  mesh.instanceMatrix.setUsage(T.DynamicDrawUsage);
  mesh.frustumCulled = false;
  return mesh;
}

/** Stretch cylinder i from one point to another. */
const stretch = (() => {
  const T = MeshCat.THREE, up = new T.Vector3(0, 1, 0), along = new T.Vector3();
  const middle = new T.Vector3(), scale = new T.Vector3(1, 1, 1);
  const turn = new T.Quaternion(), matrix = new T.Matrix4();
  return (mesh, i, from, to, thick = 1) => {
    along.set(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
    middle.fromArray(from).addScaledVector(along, 0.5);
    const length = Math.max(along.length(), 1e-9);
    turn.setFromUnitVectors(up, along.divideScalar(length));
    mesh.setMatrixAt(i, matrix.compose(middle, turn, scale.set(thick, length, thick)));
  };
})();

/** Point i of a flat array of coordinates. */
const pointOf = (flat, i) => flat.subarray(3 * i, 3 * i + 3);

/** Bodies that keep their shape: arm and platform, one matrix a pose. */
class Bodies {
  constructor({ viewer, plan, view }) {
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

/** Draw the first picture; without a graphics card, or on a slow one, shadows are left out. */
function adaptQuality({ viewer }) {
  const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4);
  const light = viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object;
  const time = () => {
    const start = performance.now();
    viewer.render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - start;
  };
  const names = gl.getExtension("WEBGL_debug_renderer_info"), name = gl.getParameter(names?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER);
  light.castShadow = !/swiftshader|llvmpipe|software|basic render/i.test(name);
  time(); // compiles the shaders
  if (light.castShadow && time() > 120) light.castShadow = false;
  viewer.set_dirty();
  return light.castShadow ? "high" : "low";
}
