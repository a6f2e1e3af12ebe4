/* The start: what the browser must offer, then the page. */

async function start() {
  if (!("DecompressionStream" in window))
    return fail("This preview needs a browser from 2023 or newer (DecompressionStream).");
  const { book, view } = await unpack(byId("payload").textContent);
  if (!document.createElement("canvas").getContext("webgl2"))
    return fail("This preview needs WebGL 2, which this browser does not offer: update it, or allow graphics acceleration in its settings. Without pictures:",
      book.drapes.flatMap(({ title, verdict }) => [title, ...verdict]));
  byId("payload").remove();
  window.app = new App(book, view);
  document.body.dataset.quality = app.drapes.map(adaptQuality).includes("low") ? "low" : "high";
  document.body.dataset.ready = "yes";
}

start().catch((error) => {
  console.error(error);
  fail("This preview could not be shown: the file may be incomplete.");
});
