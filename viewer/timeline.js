/* The page: panels, slider, keys, address. Texts from the plan enter by textContent only. */

const byId = (id) => document.getElementById(id);
const millimeters = (meters, digits = 1) => `${(1e3 * meters).toFixed(digits)} mm`;

/** New element with a text, a class or attributes. */
function element(tag, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/** Say on the page why nothing is shown. */
function fail(message) {
  document.body.append(element("div", message, { id: "failure", class: "panel", role: "alert" }));
  document.body.dataset.ready = "failed";
}

/** Header and legend: what does not depend on the pose. */
function fillPanels(plan, palette) {
  document.title = plan.title;
  byId("title").textContent = plan.title;
  byId("subtitle").textContent = plan.subtitle;
  byId("verdict").className = plan.good ? "good" : "bad";
  for (const sentence of plan.verdict) byId("verdict").append(element("li", sentence));
  const bar = byId("bar").getContext("2d"), image = bar.createImageData(255, 1);
  for (let i = 0; i < 255; i++)
    for (let c = 0; c < 4; c++) image.data[4 * i + c] = c < 3 ? palette[3 * (i + 1) + c] : 255;
  bar.putImageData(image, 0, 0);
  for (let i = 0; i <= 3; i++) {
    const value = +((1e3 * plan.gap_shown * i) / 3).toFixed(1);
    const tick = element("span", i === 3 ? `≥ ${value} mm` : `${value}`);
    tick.style.left = `${(100 * i) / 3}%`;
    byId("ticks").append(tick);
  }
  byId("depth").style.background = `rgb(${palette.slice(0, 3).join(",")})`;
  byId("depth-text").textContent = `Penetrates > ${millimeters(plan.penetration)}`;
  byId("spacing").textContent = `Mold grid ${+(1e3 * plan.spacing).toFixed(2)} mm`;
  for (const state of plan.states) {
    const row = element("div", "", { class: "row" }), mark = element("span", state.symbol, { class: "swatch" });
    mark.style.background = state.color;
    row.append(mark, element("span", state.name), element("b", "0", { class: "count" }));
    byId("states").append(row);
  }
}

/** First and last pose of each run of poses with the same phase. */
function phaseRuns(phases) {
  const runs = [];
  phases.forEach((name, k) => {
    if (k === 0 || name !== phases[k - 1]) runs.push({ name, first: k, last: k });
    else runs[runs.length - 1].last = k;
  });
  return runs;
}

/** Contact area over the poses, with the phases behind it and the pose shown. */
function drawChart(plan, runs, pose) {
  const canvas = byId("chart"), ratio = devicePixelRatio, ink = canvas.getContext("2d");
  const width = canvas.clientWidth, height = canvas.clientHeight, last = Math.max(1, plan.labels.length - 1);
  canvas.width = width * ratio;
  canvas.height = height * ratio;
  ink.scale(ratio, ratio);
  ink.font = "10px system-ui, 'DejaVu Sans', sans-serif";
  const x = (k) => 8 + ((width - 16) * Math.min(last, Math.max(0, k))) / last;
  const y = (share) => height - 2 - (height - 18) * share;
  runs.forEach((run, i) => {
    const from = x(run.first - 0.5), to = x(run.last + 0.5);
    ink.fillStyle = i % 2 ? "#e9eef3" : "#f6f8fa";
    ink.fillRect(from, 0, to - from, height);
    ink.fillStyle = "#465261";
    if (ink.measureText(run.name).width < to - from - 6) ink.fillText(run.name, from + 4, 10);
  });
  ink.beginPath();
  plan.contact.forEach((share, k) => ink.lineTo(x(k), y(share)));
  ink.strokeStyle = "#0b5fa5";
  ink.lineWidth = 1.5;
  ink.stroke();
  ink.lineTo(x(last), height - 2);
  ink.lineTo(x(0), height - 2);
  ink.fillStyle = "rgba(11, 95, 165, 0.16)";
  ink.fill();
  ink.fillStyle = "#465261";
  ink.textAlign = "right";
  ink.fillText("contact area, 0 to 100 %", x(last) - 4, 10);
  ink.fillStyle = "#1d2733";
  ink.fillRect(x(pose) - 0.5, 0, 1, height);
}

/** Names at the cups: mode "landing" tags those that land, "all" every cup. */
function drawTags(viewer, cups, plan, pose, mode) {
  const canvas = byId("tags"), ratio = devicePixelRatio, ink = canvas.getContext("2d");
  canvas.width = innerWidth * ratio;
  canvas.height = innerHeight * ratio;
  if (mode === "off" || !viewer.scene_tree.find(["meshcat", "cups"]).object.visible) return;
  ink.scale(ratio, ratio);
  ink.textAlign = "center";
  ink.textBaseline = "middle";
  for (let i = 0; i < cups.count; i++) {
    const state = cups.state(pose, i), landing = state === 1;
    if (mode === "landing" && !landing) continue;
    const place = yUp(cups.at.tops.subarray(3 * i, 3 * i + 3)).project(viewer.camera);
    const left = ((place.x + 1) / 2) * innerWidth, top = ((1 - place.y) / 2) * innerHeight;
    const text = `${plan.states[state].symbol} ${cups.names[i]}`;
    ink.font = "600 11px system-ui, 'DejaVu Sans', sans-serif";
    const wide = ink.measureText(text).width + 8;
    ink.fillStyle = landing ? plan.states[1].color : "rgba(255, 255, 255, 0.8)";
    ink.fillRect(left - wide / 2, top - 22, wide, 15);
    ink.fillStyle = landing ? "#ffffff" : "#1d2733";
    ink.fillText(text, left, top - 14);
  }
}

/** The whole page: its state is the pose, the view, what is visible, and playing. */
class Timeline {
  constructor(viewer, plan, view) {
    Object.assign(this, { viewer, plan, pose: 0, tags: "landing", timer: null, preset: null });
    this.last = plan.labels.length - 1;
    this.runs = phaseRuns(plan.phases);
    this.ply = new Ply(viewer, plan, view);
    this.cups = new Cups(viewer, plan, view);
    this.bodies = new Bodies(viewer, plan, view);
    lightStage(viewer, plan.boxes.drape);
    fillPanels(plan, view(Uint8Array, plan.palette));
    this.addButtons();
    this.addKeys();
    const render = viewer.render.bind(viewer);
    viewer.render = () => { render(); drawTags(viewer, this.cups, plan, this.pose, this.tags); };
    addEventListener("resize", () => { this.look(this.preset); this.show(this.pose); });
    addEventListener("hashchange", () => this.readAddress());
    viewer.set_3d_pane_size();
    this.look(plan.opening);
    this.show(0);
    this.readAddress();
  }

  show(pose) {
    const { plan } = this, k = Math.max(0, Math.min(this.last, Math.round(pose) || 0));
    this.pose = k;
    for (const part of [this.ply, this.cups, this.bodies]) part.show(k);
    const text = `${k + 1} of ${this.last + 1} · ${plan.labels[k]}`;
    byId("label").textContent = text;
    byId("label").title = text;
    byId("slider").value = k;
    byId("slider").setAttribute("aria-valuetext", text);
    byId("contact").textContent = `${(100 * plan.contact[k]).toFixed(1)} %`;
    const gap = (value, digits) => (value < plan.beside ? millimeters(value, digits) : "–");
    byId("lowest").textContent = gap(plan.lowest[k], 2);
    byId("highest").textContent = gap(plan.highest[k], 1);
    document.querySelectorAll("#states .count").forEach((cell, state) => {
      let count = 0;
      for (let i = 0; i < this.cups.count; i++) count += this.cups.state(k, i) === state;
      cell.textContent = count;
    });
    drawChart(plan, this.runs, k);
    this.writeAddress();
    this.viewer.set_dirty();
  }

  look(name) {
    const preset = this.plan.views.find((item) => item.name === name);
    if (!preset) return;
    if (this.preset !== name) for (const part of this.parts) part.set(!preset.hide.includes(part.name));
    this.preset = name;
    placeCamera(this.viewer, preset, this.plan.boxes[preset.box], this.plan.boxes.cell);
    for (const button of byId("views").children)
      button.setAttribute("aria-pressed", button.textContent === name);
    this.writeAddress();
  }

  play(on) {
    clearInterval(this.timer);
    this.timer = null;
    if (on && this.pose === this.last) this.show(0);
    if (on) this.timer = setInterval(() => {
      this.show(this.pose + 1);
      if (this.pose === this.last) this.play(false);
    }, 200);
    byId("play").textContent = on ? "❚❚ Pause" : "▶ Play";
  }

  jump(pose) {
    this.play(false);
    this.show(pose);
  }

  /** The address follows with a delay: browsers refuse many changes a second. */
  writeAddress() {
    clearTimeout(this.writing);
    this.writing = setTimeout(() => {
      history.replaceState(null, "", `#step=${this.pose + 1}&view=${this.preset}`);
    }, 150);
  }

  readAddress() {
    const wanted = new URLSearchParams(location.hash.slice(1));
    if (wanted.has("view")) this.look(wanted.get("view"));
    if (wanted.has("step")) this.jump(Number(wanted.get("step")) - 1);
  }

  addButtons() {
    byId("slider").max = this.last;
    byId("slider").oninput = (event) => this.jump(Number(event.target.value));
    byId("play").onclick = () => this.play(!this.timer);
    byId("prev").onclick = () => this.jump(this.pose - 1);
    byId("next").onclick = () => this.jump(this.pose + 1);
    byId("about").onclick = () => byId("licenses").showModal();
    byId("close").onclick = () => byId("licenses").close();
    byId("licenses-text").textContent = byId("notices").textContent;
    for (const { name } of this.plan.views) {
      const button = element("button", name, { "aria-pressed": false });
      button.onclick = () => this.look(name);
      byId("views").append(button);
    }
    this.parts = ["Arm", "Tool", "Cups", "Mold"].map((name) => this.addSwitch(name));
    const modes = ["landing", "all", "off"], tags = element("button", "Names: landing", { id: "names" });
    tags.onclick = () => {
      this.tags = modes[(modes.indexOf(this.tags) + 1) % 3];
      tags.textContent = `Names: ${this.tags}`;
      this.viewer.set_dirty();
    };
    byId("parts").append(tags);
  }

  addSwitch(name) {
    const { object } = this.viewer.scene_tree.find(["meshcat", name.toLowerCase()]);
    const button = element("button", name);
    const set = (on) => {
      object.visible = on;
      button.setAttribute("aria-pressed", on);
      this.viewer.set_dirty();
    };
    button.onclick = () => set(!object.visible);
    byId("parts").append(button);
    return { name, set };
  }

  addKeys() {
    const moves = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1, PageDown: 8, PageUp: -8 };
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.altKey || event.metaKey || byId("licenses").open) return;
      if (event.key in moves) this.jump(this.pose + moves[event.key]);
      else if (event.key === "Home") this.jump(0);
      else if (event.key === "End") this.jump(this.last);
      else if (event.key === " " && event.target.tagName !== "BUTTON") this.play(!this.timer);
      else return;
      event.preventDefault();
    });
  }
}

/** Gap under the pointer. */
function addProbe(viewer, timeline) {
  const T = MeshCat.THREE, ray = new T.Raycaster(), tip = byId("tip");
  let waiting = false;
  byId("pane").addEventListener("pointerleave", () => { tip.hidden = true; });
  byId("pane").addEventListener("pointermove", (event) => {
    if (waiting || event.buttons) { tip.hidden = true; return; }
    waiting = true;
    requestAnimationFrame(() => {
      waiting = false;
      ray.setFromCamera(new T.Vector2((2 * event.clientX) / innerWidth - 1, 1 - (2 * event.clientY) / innerHeight), viewer.camera);
      const [hit] = ray.intersectObject(timeline.ply.mesh);
      tip.hidden = !hit;
      if (!hit) return;
      const { gap_shown, penetration } = timeline.plan, { ply } = timeline;
      const level = ply.gap[timeline.pose * ply.track.count + hit.face.a];
      const bounds = { 0: `penetrates more than ${millimeters(penetration)}`, 255: `gap ≥ ${millimeters(gap_shown, 0)}` };
      tip.textContent = bounds[level] ?? `gap ${millimeters((gap_shown * (level - 1)) / 254)}`;
      tip.style.left = `${Math.min(event.clientX + 14, innerWidth - 130)}px`;
      tip.style.top = `${event.clientY + 14}px`;
    });
  });
}

/** Software rendering is slow: without shadows it keeps up. */
function adaptQuality(viewer) {
  const gl = viewer.renderer.getContext(), pixel = new Uint8Array(4);
  const time = () => {
    const start = performance.now();
    viewer.render();
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, pixel);
    return performance.now() - start;
  };
  time(); // the first picture compiles the shaders
  const slow = time() > 120;
  document.body.dataset.quality = slow ? "low" : "high";
  if (slow) viewer.scene_tree.find(["Lights", "SpotLight", "<object>"]).object.castShadow = false;
  viewer.set_dirty();
}

async function start() {
  if (!("DecompressionStream" in window))
    return fail("This preview needs a browser from 2023 or newer (DecompressionStream).");
  if (!document.createElement("canvas").getContext("webgl2"))
    return fail("This preview needs WebGL 2, which this browser does not offer.");
  const { plan, view } = await unpack(byId("payload").textContent);
  byId("payload").remove();
  const viewer = (window.viewer = new MeshCat.Viewer(byId("pane")));
  viewer.renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
  for (const blob of plan.commands) viewer.handle_command_bytearray(view(Uint8Array, blob));
  window.preview = new Timeline(viewer, plan, view);
  addProbe(viewer, window.preview);
  adaptQuality(viewer);
  document.body.dataset.ready = "yes";
}

start().catch((error) => {
  console.error(error);
  fail("This preview could not be shown: the file may be incomplete.");
});
