/* Keys, listed once: the help dialog shows what the table says. */

const KEYS = [
  ["← →", "pose before, next pose", { ArrowLeft: (app) => app.timeline.jump(app.pose - 1), ArrowRight: (app) => app.timeline.jump(app.pose + 1) }],
  ["Page up, Page down", "step before, next step; also Shift with ← →", {
    PageUp: (app) => app.timeline.jump(app.timeline.step(-1)), PageDown: (app) => app.timeline.jump(app.timeline.step(1)),
    "Shift+ArrowLeft": (app) => app.timeline.jump(app.timeline.step(-1)), "Shift+ArrowRight": (app) => app.timeline.jump(app.timeline.step(1)) }],
  ["Home, End", "first pose, last pose", { Home: (app) => app.timeline.jump(0), End: (app) => app.timeline.jump(app.timeline.last) }],
  ["Space", "play or pause", { " ": (app) => app.timeline.play(!app.timeline.timer) }],
  ["1 to 9", "views, in the order of their buttons", Object.fromEntries(
    [..."123456789"].map((key) => [key, (app) => app.look(app.book.views[key - 1]?.name)]))],
  ["C", "colors of the gap", { c: (app) => app.nextPalette() }],
  ["?", "this help", { "?": () => byId("help").showModal() }],
  ["Mouse", "drag turns, right button or two fingers move, wheel zooms; a click picks a place of the ply", {}],
];

function addKeys(app) {
  const acts = Object.assign({}, ...KEYS.map(([, , act]) => act));
  for (const [keys, text] of KEYS) byId("keys").append(element("dt", keys), element("dd", text));
  byId("ask").onclick = () => byId("help").showModal();
  addEventListener("keydown", (event) => {
    const { target } = event, typing = target.matches("select, textarea, input:not([type=range]):not([type=checkbox])");
    if (event.ctrlKey || event.altKey || event.metaKey || typing || document.querySelector("dialog[open]")) return;
    if (event.key === " " && target.matches("button, summary, input[type=checkbox]")) return;
    const act = acts[event.shiftKey && event.key.startsWith("Arrow") ? `Shift+${event.key}` : event.key];
    if (!act) return;
    act(app);
    event.preventDefault();
  });
}
