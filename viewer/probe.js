/* The probe: what the pointer is over, in words, and the exact gaps behind it. */

/** Index of the value nearest to another. */
const nearestOf = (values, at) => values.reduce((best, value, i) => (Math.abs(value - at) < Math.abs(values[best] - at) ? i : best), 0);

/** Exact gaps and material coordinates of a drape; unfolded when first asked for. */
class Material {
  constructor(drape) {
    const { material, gaps } = drape.plan.details, { poses, rows, columns } = drape.plan.ply;
    Object.assign(this, { drape, gaps, rows, columns, poses, s: material.s, t: material.t });
    this.around = material.around === null ? null : drape.view(Uint16Array, material.around);
    this.pads = material.pads === null ? null : drape.view(Int16Array, material.pads);
  }

  /** Gap of a sample at a pose, in meters. */
  gap(pose, index) {
    this.steps ??= unfold(this.drape.view(Uint8Array, this.gaps.blob), Uint16Array, 1, this.poses, this.rows, this.columns);
    return this.gaps.lowest + this.gaps.step * this.steps[pose * this.rows * this.columns + index];
  }

  /** Whether a gap is the largest that is kept: free by far, or beside the mold. */
  far(gap) { return gap > this.gaps.highest - this.gaps.step; }

  /** Index of the sample nearest to a place (s, t), in meters. */
  nearest([s, t]) { return nearestOf(this.t, t) * this.columns + nearestOf(this.s, s); }

  /** Cups that a sample depends on, each once: one on a pad, two on a strip, four in a patch. */
  cups(index) {
    return this.around === null ? [] : [...new Set(this.around.subarray(4 * index, 4 * index + 4))];
  }

  /** Cup that holds a sample, or -1. */
  pad(index) { return this.pads === null ? -1 : this.pads[index]; }

  /** Ply model below a sample: the highest rung of the strips around it, or "". */
  rung(pose, cups) {
    const { names, strips } = this.drape.plan.details.rungs, { links } = this.drape.cups;
    const indices = this.drape.view(Uint8Array, strips), count = links.length / 2;
    let highest = 0;
    for (let link = 0; link < count; link++)
      if (cups.includes(links[2 * link]) && cups.includes(links[2 * link + 1]))
        highest = Math.max(highest, indices[pose * count + link]);
    return cups.length > 1 ? names[highest] ?? "" : "";
  }

  /** Kinds of what is wrong at a sample at the pose shown, see KINDS. */
  wrong(index) {
    const inside = ({ samples = [], line = [] }) => samples.includes(index) || line.includes(index);
    return [...new Set(this.drape.marks.now.filter(inside).map(({ kind }) => kind))].map((kind) => KINDS[kind]);
  }
}

/** Lines of the probe: gap, place on the ply, cups and their states, model, what is wrong. */
function probeLines({ book }, drape, sample) {
  const { material, pose } = drape, { index, row, column } = sample;
  const gap = material.gap(pose, index), cups = material.cups(index);
  const lines = [material.far(gap) ? "far above the mold, or beside it" : `gap ${millimeters(gap, 2)}`];
  lines.push(`s ${(1e3 * material.s[column]).toFixed(0)}, t ${(1e3 * material.t[row]).toFixed(0)} mm`);
  const where = cups.length > 1 ? "between cups" : material.pad(index) < 0 ? "beyond cup" : "on cup";
  if (cups.length) lines.push(`${where} ${cups.map((cup) => `(${drape.cups.names[cup]})`).join(" ")}`);
  const states = [...new Set(cups.map((cup) => drape.cups.state(pose, cup)))].map((state) => book.states[state]);
  if (cups.length) lines.push(states.map(({ symbol, name }) => `${symbol} ${name.toLowerCase()}`).join(" · "));
  const rung = material.rung(pose, cups);
  if (rung) lines.push(`ply model ${rung}`);
  for (const { symbol, name } of material.wrong(index)) lines.push(`${symbol} ${name.toLowerCase()}`);
  return lines;
}

extensions.push((app) => {
  for (const drape of app.drapes) drape.material = new Material(drape);
  app.probe = (drape, sample) => probeLines(app, drape, sample);
});
