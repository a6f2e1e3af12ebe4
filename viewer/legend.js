/* The legend: colors of the gap, states of the cups, and figures of each drape. */

class Legend {
  constructor({ book, drapes }, choose) {
    Object.assign(this, { book, drapes });
    const names = Object.keys(book.palettes), select = byId("palette");
    for (const name of names) select.append(element("option", name));
    select.onchange = () => choose(select.value);
    for (let i = 0; i <= 3; i++) {
      const value = +((1e3 * book.gap_shown * i) / 3).toFixed(1);
      const tick = element("span", i === 3 ? `≥ ${value} mm` : `${value}`);
      tick.style.left = `${(100 * i) / 3}%`;
      byId("ticks").append(tick);
    }
    const depths = new Set(drapes.map(({ plan }) => millimeters(plan.penetration)));
    byId("depth-text").textContent = `Penetrates > ${[...depths].join(" | ")}`;
    byId("spacing").textContent = `Mold grid ${+(1e3 * drapes[0].plan.spacing).toFixed(2)} mm`;
    if (drapes.length > 1) {
      const heads = element("tr");
      heads.append(element("td"), ...drapes.map(({ letter }) => element("th", letter, { scope: "col" })));
      byId("figures").append(heads);
    }
    this.contact = this.addRow("In contact, %");
    this.lowest = this.addRow("Smallest gap, mm");
    this.highest = this.addRow("Largest gap, mm");
    byId("figures").append(element("tr", "", { class: "gapped" }));
    this.states = book.states.map((state) => this.addRow(state.name, state));
    const wrong = Object.keys(KINDS).filter((kind) => drapes.some(({ marks }) => marks.all.some((mark) => mark.kind === kind)));
    if (wrong.length) byId("figures").append(element("tr", "", { class: "gapped" }));
    this.wrong = wrong.map((kind) => [kind, this.addRow(KINDS[kind].name, KINDS[kind], "fault")]);
  }

  /** A row of the table: a name, and a cell for each drape. */
  addRow(name, state = null, kind = state ? "count" : "figure") {
    const row = element("tr"), head = element("th", "", { scope: "row" });
    if (state) {
      const mark = element("span", state.symbol, { class: "swatch", "aria-hidden": "true" });
      mark.style.background = state.color;
      head.append(mark);
    }
    head.append(name);
    const cells = this.drapes.map(() => element("td", "", { class: kind }));
    row.append(head, ...cells);
    byId("figures").append(row);
    return cells;
  }

  /** Paint the bar in the colors of a palette: three bytes for each level of the gap. */
  paint(palette) {
    const bar = byId("bar").getContext("2d"), image = bar.createImageData(255, 1);
    for (let i = 0; i < 255; i++)
      for (let c = 0; c < 4; c++) image.data[4 * i + c] = c < 3 ? palette[3 * (i + 1) + c] : 255;
    bar.putImageData(image, 0, 0);
    byId("depth").style.background = `rgb(${palette.slice(0, 3).join(",")})`;
  }

  show() {
    this.drapes.forEach(({ plan, pose, cups, marks }, i) => {
      const gap = (value, digits) => (value < this.book.beside ? (1e3 * value).toFixed(digits).replace("-", "−") : "–");
      this.contact[i].textContent = (100 * plan.contact[pose]).toFixed(1);
      this.lowest[i].textContent = gap(plan.lowest[pose], 2);
      this.highest[i].textContent = gap(plan.highest[pose], 1);
      cups.counts(pose).forEach((count, state) => { this.states[state][i].textContent = count; });
      for (const [kind, cells] of this.wrong) cells[i].textContent = marks.count(kind);
    });
  }
}
