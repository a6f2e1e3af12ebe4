/* Figures by hand: SVG elements, round scales, lines through values. */

/** New SVG element with attributes, a text, and children. */
function svg(tag, attributes = {}, content = []) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) made.setAttribute(name, value);
  made.append(...[content].flat());
  return made;
}

/** Function from values in [low, high] to places in [from, to], kept inside. */
function scale(low, high, from, to) {
  return (value) => from + ((to - from) * (Math.min(high, Math.max(low, value)) - low)) / (high - low);
}

/** Round values at equal distances, at most `count` of them, that lie in [low, high]. */
function ticks(low, high, count) {
  const rough = (high - low) / Math.max(1, count), power = 10 ** Math.floor(Math.log10(rough));
  const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough * (1 - 1e-9));
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) found.push(+(k * step).toPrecision(12));
  return found;
}

/** The least round number, 1, 2 or 5 times a power of ten, that is not below a value. */
function roundUp(value) {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 2, 5, 10].find((factor) => factor * power >= value * (1 - 1e-9));
}

/** Places as the `points` of a polyline. */
const through = (places) => places.map(([x, y]) => `${x.toFixed(2)},${y.toFixed(2)}`).join(" ");

/** Tell the style how high the foot is, so that what stands above it ends there. */
new ResizeObserver(() => document.body.style.setProperty("--foot", `${byId("foot").offsetHeight}px`)).observe(byId("foot"));

const DRAPE_COLORS = ["#0b5fa5", "#b94700"]; // of lines, one for each drape of the page
