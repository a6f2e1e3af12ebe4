/* The verdict's sentences: each leads to the moment and the place it speaks of. */

/** Show a statement's moment, and bring its place into the middle, marked. */
function jumpTo(app, drape, { pose, place }) {
  if (pose !== null) app.showPose(drape, pose);
  if (place === null) return;
  const index = drape.material.nearest(place), points = drape.ply.points.array;
  const point = [...points.subarray(3 * index, 3 * index + 3)];
  app.focus(drape, point);
  drape.pin.show(point, app.pose);
}

/** A pin in the ply at the place last jumped to; it goes when the moment changes. */
class Pin {
  constructor({ viewer, plan }) {
    const T = MeshCat.THREE, size = plan.cups.radius;
    const shape = new T.ConeGeometry(0.35 * size, 2 * size, 12).rotateX(Math.PI).translate(0, size, 0).rotateX(Math.PI / 2);
    this.mesh = new T.Mesh(shape, new T.MeshBasicMaterial({ color: 0xc2185b, depthTest: false }));
    this.mesh.renderOrder = 9;
    this.mesh.visible = false;
    viewer.set_object(["meshcat", "pin"], this.mesh);
  }

  show(point, moment) {
    this.mesh.position.set(...point);
    this.mesh.visible = true;
    this.moment = moment;
  }

  follow(moment) { this.mesh.visible &&= moment === this.moment; }
}

/** Whether a sentence speaks of a moment or a place. */
const leads = ({ pose, place }) => pose !== null || place !== null;

/** A sentence as an entry of the list: a button where there is something to jump to. */
function statementEntry(app, drape, told) {
  const entry = element("li", "", { class: told.wrong ? "wrong" : told.warns ? "warns" : "" });
  if (!leads(told)) entry.textContent = told.text;
  else {
    const button = element("button", told.text, { type: "button", class: "jump" });
    button.onclick = () => jumpTo(app, drape, told);
    entry.append(button);
  }
  return entry;
}

/** Entries that can wait, folded into one. */
function foldedEntry(entries) {
  const entry = element("li", "", { class: "more" }), fold = element("details"), list = element("ul", "", { class: "verdict" });
  list.append(...entries);
  fold.append(element("summary", `${entries.length} more`), list);
  entry.append(fold);
  return entry;
}

extensions.push((app) => {
  for (const drape of app.drapes) {
    const { statements } = drape.plan.details, [headline] = statements;
    const entries = (chosen) => chosen.map((one) => statementEntry(app, drape, one));
    const told = statements.filter((one) => !one.aside && (one !== headline || leads(one)));
    const more = statements.filter(({ aside }) => aside);
    drape.pin = new Pin(drape);
    drape.dom.head.querySelector(".answer").classList.toggle("led", leads(headline));
    drape.dom.verdict.replaceChildren(...entries(told));
    if (more.length) drape.dom.verdict.append(foldedEntry(entries(more)));
  }
  app.onPose((moment) => { for (const { pin } of app.drapes) pin.follow(moment); });
});
