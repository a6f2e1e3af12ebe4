/* Robustness: how likely the order is lost, and which uncertainty hurts most. */

const percent = (share) => `${+(100 * share).toFixed(1)} %`;

/** P with its interval, as a bar from 0 to 100 %. */
function likelihood({ share, low_95, high_95 }, width) {
  const x = scale(0, 1, 6, width - 6);
  return svg("svg", { class: "plot", width, height: 34, role: "img", "aria-label": `Wrong order in ${percent(share)}, 95 % within ${percent(low_95)} to ${percent(high_95)}` }, [
    svg("line", { class: "grid", x1: x(0), x2: x(1), y1: 10, y2: 10 }),
    svg("rect", { class: "interval", x: x(low_95), width: Math.max(2, x(high_95) - x(low_95)), y: 5, height: 10 }),
    svg("circle", { class: "share", cx: x(share), cy: 10, r: 4 }),
    ...[0, 0.5, 1].map((value) => svg("text", { class: ["start", "middle", "end"][2 * value], x: x(value), y: 30 }, percent(value))),
  ]);
}

/**
 * A tornado: one row for each uncertainty alone, a bar from the 5 % to the 95 % quantile
 * in millimeters with the median marked. Values that reach `most` may be larger.
 */
function tornado(rows, label, width, most) {
  const high = roundUp(Math.max(0.1, ...rows.map(({ range }) => range["95"] ?? 0)));
  const x = scale(Math.min(0, ...rows.map(({ range }) => range["5"] ?? 0)), high, 6, width - 6);
  const bars = rows.flatMap(({ name, range }, k) => {
    const top = 26 * k, [from, middle, to] = ["5", "50", "95"].map((key) => x(range[key] ?? high));
    const text = ["5", "50", "95"].map((key) => (range[key] === null || range[key] >= most ? `≥ ${most}` : range[key].toFixed(2))).join(" · ");
    return [svg("text", { x: 6, y: top + 11 }, name), svg("text", { class: "end", x: width - 6, y: top + 11 }, text),
      svg("rect", { class: "interval", x: from, width: Math.max(2, to - from), y: top + 14, height: 8 }),
      svg("line", { class: "median", x1: middle, x2: middle, y1: top + 13, y2: top + 23 })];
  });
  const floor = 26 * rows.length + 2;
  const axis = ticks(Math.min(0, ...rows.map(({ range }) => range["5"] ?? 0)), high, 4).flatMap((value) => [
    svg("line", { class: "grid", x1: x(value), x2: x(value), y1: 0, y2: floor }),
    svg("text", { class: value === high ? "end" : value === 0 ? "start" : "middle", x: x(value), y: floor + 12 }, `${value}`)]);
  return svg("svg", { class: "plot tornado", width, height: floor + 16, role: "img", "aria-label": label }, [...axis, ...bars]);
}

/** What a plan says of itself under uncertainty. */
function robustnessFigure({ letter, plan }, several) {
  const found = plan.details.robustness, body = element("div"), wrong = found.wrong_order, width = 210;
  body.append(element("h2", `${several ? `${letter}: ` : ""}Wrong order: P = ${wrong.share.toFixed(3)}`));
  body.append(element("p", `${wrong.samples} of ${found.samples} samples; 95 % within ${wrong.low_95.toFixed(3)} to ${wrong.high_95.toFixed(3)}`, { class: "muted" }));
  body.append(likelihood(wrong, width));
  const alone = found.parameters, rows = (key) => alone.map((one) => ({ name: one.label, range: one[key] }));
  const figures = [["press_mm", "Ply pressed into the mold, mm", Infinity]];
  if (alone.some((one) => one.P > 0 || one.margin_mm["5"] < one.margin_mm["95"])) figures.unshift(["margin_mm", "Least margin, mm", found.most_mm]);
  if (alone.length) {
    body.append(element("h2", `Each uncertainty alone, ${alone[0].samples} samples`));
    for (const [key, name, most] of figures)
      body.append(element("p", `${name}: 5 · 50 · 95 % of samples`, { class: "muted" }), tornado(rows(key), `${name}, each uncertainty alone`, width, most));
  }
  return body;
}

extensions.push((app) => {
  const stated = app.drapes.filter(({ plan }) => plan.details.robustness);
  if (!stated.length) return;
  const body = element("div");
  body.append(...stated.map((drape) => robustnessFigure(drape, app.drapes.length > 1)));
  app.addPanel("Robustness", body, { label: "The plan under uncertainty" });
});
