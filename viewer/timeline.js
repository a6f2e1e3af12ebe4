/* The time line: moments that all drapes share, steps of the wave, and playing. */

/** Runs of moments of the same phase and wave step: first and last of each. */
function runsOf(moments) {
  const runs = [];
  moments.forEach(({ phase, step }, k) => {
    const run = runs[runs.length - 1];
    if (run && run.phase === phase && run.step === step) run.last = k;
    else runs.push({ phase, step, first: k, last: k });
  });
  return runs;
}

class Timeline {
  /**
   * @param moments Of the book: phase, step and the pose of each drape.
   * @param show Called with a moment that is to be shown.
   */
  constructor(moments, show) {
    Object.assign(this, { moments, show, runs: runsOf(moments), last: moments.length - 1, timer: null });
    const slider = byId("slider");
    slider.max = this.last;
    slider.oninput = () => this.jump(Number(slider.value));
    byId("prev").onclick = () => this.jump(this.at - 1);
    byId("next").onclick = () => this.jump(this.at + 1);
    byId("prev-step").onclick = () => this.jump(this.step(-1));
    byId("next-step").onclick = () => this.jump(this.step(1));
    byId("play").onclick = () => this.play(!this.timer);
  }

  /** Mark a moment as shown; `text` says what happens. */
  mark(moment, text) {
    this.at = moment;
    const slider = byId("slider"), label = byId("label");
    slider.value = moment;
    slider.setAttribute("aria-valuetext", text);
    label.textContent = label.title = text;
    byId("prev").disabled = byId("prev-step").disabled = moment === 0;
    byId("next").disabled = byId("next-step").disabled = moment === this.last;
  }

  /** Where the next step ends, or the one before. */
  step(way) {
    const ends = this.runs.map((run) => run.last);
    return way > 0 ? ends.find((end) => end > this.at) ?? this.last : ends.findLast((end) => end < this.at) ?? 0;
  }

  /** Moment at which wave step `number` stands, 0 the start cup's; or null. */
  endOf(number) {
    return this.runs.findLast((run) => run.step === number)?.last ?? null;
  }

  jump(moment) {
    this.play(false);
    this.show(moment);
  }

  play(on) {
    clearInterval(this.timer);
    this.timer = null;
    if (on && this.at === this.last) this.show(0);
    if (on) this.timer = setInterval(() => {
      this.show(this.at + 1);
      if (this.at === this.last) this.play(false);
    }, 200);
    byId("play").textContent = on ? "❚❚ Pause" : "▶ Play";
    byId("label").setAttribute("aria-live", on ? "off" : "polite");
  }
}
