/* Curves under the time line: contact area and least margin, phases, steps, and faults. */

const CURVES = { top: 14, left: 8, right: 8, foot: 13, gap: 5, strip: 4 }; // [px] around and below the two bands

/** Rows of values by moment: share in contact and least margin of a drape. */
function curveValues({ timeline }, drape) {
  const { contact, details } = drape.plan, { premature, air } = details.margins;
  return timeline.moments.map(({ poses }) => {
    const pose = poses[drape.index];
    return { contact: contact[pose], margin: Math.min(premature[pose], air[pose]) };
  });
}

/** Kinds of what goes wrong in a drape, each with the poses at which it does. */
function faultsOf(drape) {
  return Object.keys(KINDS).map((kind) => ({
    drape, kind, guilty: new Set(drape.marks.all.filter((mark) => mark.kind === kind).flatMap(({ poses }) => poses)) }))
    .filter(({ guilty }) => guilty.size);
}

class Curves {
  constructor(app) {
    Object.assign(this, { app, values: app.drapes.map((drape) => curveValues(app, drape)) });
    this.most = app.drapes[0].plan.details.margins.most;
    this.least = -0.2 * this.most; // the fault has happened: how far beyond says little
    this.faults = app.drapes.flatMap((drape) => faultsOf(drape));
    this.figure = byId("chart");
    const jump = (event) => {
      const { left } = this.figure.getBoundingClientRect();
      if (event.buttons === 1) app.timeline.jump(this.momentAt(event.clientX - left));
    };
    this.figure.addEventListener("pointerdown", jump);
    this.figure.addEventListener("pointermove", jump);
    this.draw();
    addEventListener("resize", () => this.draw());
    app.onPose((moment) => this.mark(moment));
  }

  /** Draw what does not depend on the moment. */
  draw() {
    const { figure, app } = this, width = figure.clientWidth || 600, height = figure.clientHeight || 92;
    const last = app.timeline.last, { top, left, right, foot, gap, strip } = CURVES;
    const floor = height - foot - strip * this.faults.length, band = (floor - top - gap) / 2;
    this.x = scale(-0.5, last + 0.5, left, width - right);
    this.momentAt = (x) => Math.round(((x - left) / (width - right - left)) * (last + 1) - 0.5);
    this.contact = scale(0, 1, top + band, top + 1);
    this.margin = scale(this.least, this.most, floor, floor - band + 1);
    this.cursor = svg("line", { class: "cursor", y1: 0, y2: height });
    figure.replaceChildren(
      ...this.phases(height), ...this.steps(height - foot),
      ...[this.contact(0), this.margin(0)].map((y) => svg("line", { class: "zero", x1: left, x2: width - right, y1: y, y2: y })),
      ...app.drapes.flatMap(({ index }) => this.lines(index)), ...this.strips(floor),
      svg("text", { x: width - right - 3, y: top + band - 4, class: "name" }, "contact, 0 to 100 %"),
      svg("text", { x: width - right - 3, y: this.margin(0) - 4, class: "name" }, `margin to a fault, 0 to ${+(1e3 * this.most).toFixed(1)} mm`),
      this.cursor);
    this.mark(app.pose);
  }

  lines(index) {
    const color = DRAPE_COLORS[index], values = this.values[index];
    const line = (name, y) => svg("polyline", {
      class: `curve ${name}`, "data-drape": index, stroke: color,
      points: through(values.map((value, k) => [this.x(k), y(value[name])])) });
    return [line("contact", this.contact), line("margin", this.margin)];
  }

  /** Phases in turn darker and lighter, named where there is room. */
  phases(height) {
    const { moments } = this.app.timeline;
    return runsOf(moments.map(({ phase }) => ({ phase }))).flatMap(({ phase, first, last }, k) => {
      const from = this.x(first - 0.5), to = this.x(last + 0.5);
      const box = svg("rect", { class: k % 2 ? "phase dark" : "phase", x: from, width: to - from, y: 0, height });
      box.append(svg("title", {}, phase));
      return 6 * phase.length < to - from - 6 ? [box, svg("text", { x: from + 4, y: 10 }, phase)] : [box];
    });
  }

  /** A tick where each wave step stands, with its number where there is room. */
  steps(floor) {
    let free = 0;
    return this.app.timeline.runs.filter(({ step }) => step >= 0).flatMap(({ step, last }) => {
      const x = this.x(last), marks = [svg("line", { class: "step", x1: x, x2: x, y1: floor - 3, y2: floor + 3 })];
      if (x < free) return marks;
      free = x + 16;
      return [...marks, svg("text", { class: "number", x, y: floor + 11 }, `${step}`)];
    });
  }

  /** Below the curves a strip for each kind of fault, where and how long it lasts. */
  strips(floor) {
    return this.faults.flatMap(({ drape, kind, guilty }, row) =>
      runsOf(this.app.timeline.moments.map(({ poses }) => ({ phase: guilty.has(poses[drape.index]) })))
        .filter(({ phase }) => phase)
        .map(({ first, last }) => svg("rect", {
          class: "fault", "data-kind": kind, x: this.x(first - 0.5), width: this.x(last + 0.5) - this.x(first - 0.5),
          y: floor + CURVES.strip * row + 1, height: CURVES.strip - 1, fill: KINDS[kind].color }, svg("title", {}, KINDS[kind].name))));
  }

  mark(moment) {
    const x = this.x(moment);
    this.cursor.setAttribute("x1", x);
    this.cursor.setAttribute("x2", x);
    const texts = this.app.drapes.map(({ index }) => {
      const { contact, margin } = this.values[index][moment];
      const left = margin >= this.most ? `at least ${millimeters(this.most)}` : millimeters(margin, 2);
      return `${(100 * contact).toFixed(1)} % in contact, margin ${left}`;
    });
    this.figure.setAttribute("aria-label", `Contact area and least margin over the time line; now ${texts.join("; ")}`);
  }
}

extensions.push((app) => { app.curves = new Curves(app); });
