/* Small helpers of the page. Texts from a plan enter by textContent alone. */

const byId = (id) => document.getElementById(id);
const millimeters = (meters, digits = 1) => `${(1e3 * meters).toFixed(digits)} mm`;

/** New element with a text and attributes. */
function element(tag, text = "", attributes = {}) {
  const made = document.createElement(tag);
  made.textContent = text;
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  return made;
}

/** A button that stays pressed; `set(on)` also tells `act`. */
function toggle(text, act, attributes = {}) {
  const button = element("button", text, { type: "button", "aria-pressed": "false", ...attributes });
  button.set = (on) => {
    button.setAttribute("aria-pressed", String(on));
    act(on);
  };
  button.onclick = () => button.set(button.getAttribute("aria-pressed") !== "true");
  return button;
}

/** Say on the page why nothing is shown, and what else can be said. */
function fail(message, lines = []) {
  const panel = element("div", "", { id: "failure", class: "panel", role: "alert" });
  panel.append(...[message, ...lines].map((line) => element("p", line)));
  document.body.append(panel);
  document.body.dataset.ready = "failed";
}
