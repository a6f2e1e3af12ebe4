/* What the plans were made from, as a table: a column for each drape. */

extensions.push((app) => {
  const all = app.drapes.map(({ plan }) => new Map(plan.details.facts));
  const names = [...new Set(all.flatMap((facts) => [...facts.keys()]))];
  if (!names.length) return;
  const table = element("table", "", { class: "facts" });
  if (all.length > 1) {
    const heads = element("tr");
    heads.append(element("td"), ...app.drapes.map(({ letter }) => element("th", letter, { scope: "col" })));
    table.append(heads);
  }
  for (const name of names) {
    const row = element("tr");
    row.append(element("th", name, { scope: "row" }), ...all.map((facts) => element("td", facts.get(name) ?? "–")));
    table.append(row);
  }
  const body = element("div");
  body.append(element("h2", "Plan"), table);
  app.addPanel("Plan", body, { label: "What the plan was made from" });
});
