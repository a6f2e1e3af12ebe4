/* The section: gap between ply and mold along a fiber line, against arc length. */

const SECTION = { left: 44, right: 10, top: 8, foot: 30 }; // [px] around the plot

/** Samples of a line of the ply: family "s" runs along a row, "t" along a column. */
function lineSamples({ rows, columns }, { family, number }) {
  const count = family === "s" ? columns : rows;
  return Array.from({ length: count }, (_, k) => (family === "s" ? number * columns + k : k * columns + number));
}

/** Arc length and gap of each sample of a line at the drape's pose, in meters. */
function sectionValues(drape, line) {
  const points = drape.ply.points.array, { material, pose } = drape;
  let length = 0, before = null;
  return lineSamples(material, line).map((index) => {
    const at = [points[3 * index], points[3 * index + 1], points[3 * index + 2]];
    if (before) length += Math.hypot(...at.map((value, c) => value - before[c]));
    before = at;
    return { index, length, gap: material.gap(pose, index) };
  });
}

/** Runs of a line's samples on the pad of one cup: the cup, first and last sample. */
function padRuns(material, samples) {
  const runs = [];
  samples.forEach((index, k) => {
    const cup = material.pad(index), run = runs[runs.length - 1];
    if (cup < 0) return;
    if (run && run.cup === cup) run.last = k;
    else runs.push({ cup, first: k, last: k });
  });
  return runs;
}

class Section {
  constructor(app) {
    Object.assign(this, { app, line: { family: "s", number: 0 } });
    this.figure = svg("svg", { class: "plot", role: "img" });
    this.families = element("select", "", { "aria-label": "Direction of the section" });
    for (const [value, text] of [["s", "along s, a row"], ["t", "along t, a column"]])
      this.families.append(element("option", text, { value }));
    this.numbers = element("select", "", { "aria-label": "Fiber line of the section" });
    this.families.onchange = () => this.choose({ family: this.families.value, number: Infinity });
    this.numbers.onchange = () => this.choose({ ...this.line, number: Number(this.numbers.value) });
    const controls = element("div", "", { class: "controls" });
    controls.append(element("h2", "Section"), this.families, this.numbers, element("span", "or click the ply", { class: "muted" }));
    const body = element("div");
    body.append(controls, this.figure);
    this.panel = app.addPanel("Section", body, { place: "wide", label: "Section through a fiber line" });
    this.traces = app.drapes.map((drape) => this.addTrace(drape));
    this.fill();
    this.choose({ family: "s", number: Infinity });
    app.onClick(({ material }, { row, column }) => {
      const [across, number] = this.line.family === "s" ? ["t", row] : ["s", column];
      this.choose({ ...this.line, number: nearestOf(app.drapes[0].material[across], material[across][number]) });
    });
    app.onPose(() => this.show());
    new MutationObserver(() => this.show()).observe(this.panel.element, { attributes: true, attributeFilter: ["hidden"] });
  }

  get open() { return !this.panel.element.hidden; }

  /** The line as it lies in the scene. */
  addTrace(drape) {
    const T = MeshCat.THREE, shape = new T.BufferGeometry();
    shape.setAttribute("position", drape.ply.points);
    const trace = new T.Line(shape, new T.LineBasicMaterial({ color: 0xc2185b, depthTest: false, linewidth: 2 }));
    trace.frustumCulled = false;
    trace.renderOrder = 8;
    drape.viewer.set_object(["meshcat", "section"], trace);
    return trace;
  }

  /** Lines to choose from, those through the middle of cups named by them. */
  fill() {
    const { material, cups } = this.app.drapes[0], { family } = this.line;
    const lines = family === "s" ? material.t : material.s, across = family === "s" ? "t" : "s";
    this.numbers.replaceChildren(...lines.map((value, number) => {
      const pads = padRuns(material, lineSamples(material, { family, number }));
      const named = pads.length ? `, cups (${cups.names[pads[0].cup]}) to (${cups.names[pads.at(-1).cup]})` : "";
      return element("option", `${across} ${(1e3 * value).toFixed(0)} mm${named}`, { value: number });
    }));
  }

  /** The line through cups that is nearest to the middle of the ply. */
  middle(family, count) {
    const { material } = this.app.drapes[0], half = (count - 1) / 2;
    const numbers = Array.from({ length: count }, (_, number) => number).sort((a, b) => Math.abs(a - half) - Math.abs(b - half));
    return numbers.find((number) => padRuns(material, lineSamples(material, { family, number })).length) ?? numbers[0];
  }

  /** Show another line; a number beyond them stands for the one in the middle. */
  choose({ family, number }) {
    const { rows, columns } = this.app.drapes[0].material, count = family === "s" ? rows : columns;
    const other = family !== this.line.family;
    this.line = { family, number: number < count ? number : this.middle(family, count) };
    if (other) this.fill();
    this.families.value = family;
    this.numbers.value = this.line.number;
    this.show();
  }

  /** The line of another drape at the same place of the ply. */
  lineOf({ material }) {
    const { family, number } = this.line, across = family === "s" ? "t" : "s";
    return { family, number: nearestOf(material[across], this.app.drapes[0].material[across][number]) };
  }

  show() {
    this.traces.forEach((trace, k) => {
      const drape = this.app.drapes[k];
      trace.visible = this.open;
      if (this.open) trace.geometry.setIndex(lineSamples(drape.material, this.lineOf(drape)));
      drape.viewer.set_dirty();
    });
    if (this.open) this.draw();
  }

  draw() {
    const { app, figure, line } = this, width = figure.clientWidth || 600, height = figure.clientHeight || 150;
    const { left, right, top, foot } = SECTION, values = app.drapes.map((drape) => sectionValues(drape, this.lineOf(drape)));
    const shown = values.flat().filter(({ gap }) => gap < app.book.gap_shown);
    const low = Math.min(-1e-3, ...shown.map(({ gap }) => gap)), high = roundUp(Math.max(2e-3, ...shown.map(({ gap }) => gap)));
    const longest = Math.max(...values.flat().map(({ length }) => length)), x = scale(0, longest, left, width - right);
    const y = scale(low, high, height - foot, top);
    figure.replaceChildren(
      svg("rect", { class: "mold", x: left, width: width - left - right, y: y(0), height: height - foot - y(0) }),
      ...this.axes(x, y, width, height, [low, high], longest),
      ...app.drapes.flatMap((drape, k) => this.drape(drape, values[k], x, y, height - foot)));
    const least = Math.min(...values.flat().map(({ gap }) => gap));
    figure.setAttribute("aria-label", `Gap against arc length along ${line.family}, ${this.numbers.selectedOptions[0]?.textContent ?? ""}; smallest gap ${millimeters(least, 2)}`);
  }

  axes(x, y, width, height, [low, high], longest) {
    const { left, right, foot } = SECTION, floor = height - foot, marks = [];
    for (const value of ticks(1e3 * low, 1e3 * high, 4)) {
      const at = y(1e-3 * value);
      marks.push(svg("line", { class: value ? "grid" : "zero", x1: left, x2: width - right, y1: at, y2: at }),
        svg("text", { class: "end", x: left - 5, y: at + 3.5 }, `${value}`));
    }
    for (const touch of new Set(this.app.drapes.map(({ plan }) => y(plan.touch))))
      marks.push(svg("line", { class: "touch", x1: left, x2: width - right, y1: touch, y2: touch }));
    for (const value of ticks(0, 1e3 * longest, width / 90))
      marks.push(svg("text", { class: "middle", x: x(1e-3 * value), y: floor + 13 }, `${value}`));
    marks.push(svg("text", { class: "middle", x: (left + width - right) / 2, y: floor + 26 }, `arc length along ${this.line.family}, mm`));
    marks.push(svg("text", { class: "middle", transform: `translate(11 ${floor / 2}) rotate(-90)` }, "gap, mm"));
    return marks;
  }

  /** Gap of one drape as a line, its cups as bars below it, what is wrong in red. */
  drape(drape, values, x, y, floor) {
    const { material, pose, book } = drape, marks = [];
    padRuns(material, values.map(({ index }) => index)).forEach(({ cup, first, last }) => {
      const state = book.states[drape.cups.state(pose, cup)], from = x(values[first].length), to = x(values[last].length);
      const bar = svg("rect", { class: "cup", "data-cup": cup, x: from, width: to - from, y: floor - 5 - 6 * drape.index, height: 5, fill: state.color });
      bar.append(svg("title", {}, `cup ${drape.cups.names[cup]}: ${state.name}`));
      marks.push(bar);
    });
    marks.push(svg("polyline", { class: "curve gap", "data-drape": drape.index, stroke: DRAPE_COLORS[drape.index],
      points: through(values.map(({ length, gap }) => [x(length), y(gap)])) }));
    return [...marks, ...this.faults(drape, values, x, y)];
  }

  /** A dot at each sample at which something is wrong, a path for each kind. */
  faults({ marks }, values, x, y) {
    return marks.now.filter(({ samples }) => samples).map(({ kind, samples }) => {
      const inside = new Set(samples), dots = values.filter(({ index }) => inside.has(index));
      const path = dots.map(({ length, gap }) => `M${x(length).toFixed(1)},${y(gap).toFixed(1)}h0`).join("");
      return svg("path", { class: "dots", "data-kind": kind, d: path, stroke: KINDS[kind].color }, svg("title", {}, KINDS[kind].name));
    });
  }
}

extensions.push((app) => { app.section = new Section(app); });
