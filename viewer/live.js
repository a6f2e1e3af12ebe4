/* Planning as it happens: only in the page that the live server gives. */

extensions.length = 0; // panels speak of a verdict, which is not known yet

const ASK = 400; // [ms] between questions
const TRIES = 3; // failed questions until the server is taken for gone

/** What changes from pose to pose, by pose: poses can be put to it at any time. */
class Growing {
  constructor(app) {
    const [{ plan, view }] = app.drapes;
    Object.assign(this, { app, drape: app.drapes[0], poses: [] });
    const { ply, cups, bodies } = this.drape, at = (k) => this.poses[k];
    for (const key in cups.tracks) cups.tracks[key] = { read: (k, out) => at(k)[key].read(at(k).from, out) };
    ply.track = { count: ply.track.count, read: (k, out) => at(k).ply.read(at(k).from, out) };
    ply.levels = (k) => at(k).levels;
    cups.state = (k, i) => at(k).states[i];
    this.drape.front.laid = new Uint8Array(ply.track.count).fill(1); // on the mold, until it is known
    for (const body of bodies.moving) body.matrices = [];
    this.put(plan.labels.map((_, k) => k), plan, view, app.book.moments);
  }

  /** Put the poses that a header describes at their places on the time line. */
  put(places, plan, view, moments) {
    const { drape, app } = this, { timeline, book } = app, count = drape.cups.count, K = places.length;
    const { rows, columns } = plan.ply, samples = rows * columns;
    const tracks = { ply: new Track(plan.ply, view) };
    for (const key in drape.cups.tracks) tracks[key] = new Track(plan.cups[key], view);
    const gap = unfold(view(Uint8Array, plan.gap), Uint8Array, 1, K, rows, columns);
    const states = view(Uint8Array, plan.cups.states), tool = view(Float32Array, plan.tool), arm = view(Float32Array, plan.arm);
    places.forEach((k, from) => {
      const levels = gap.subarray(from * samples, (from + 1) * samples);
      this.poses[k] = { ...tracks, from, levels, states: states.subarray(from * count, (from + 1) * count) };
      for (const key of ["labels", "contact", "lowest", "highest"]) drape.plan[key][k] = plan[key][from];
      drape.bodies.moving.forEach(({ matrices }, body) => {
        const source = body ? arm : tool, first = 16 * (from + (body ? (body - 1) * K : 0));
        for (let i = 0; i < 16; i++) matrices[16 * k + i] = source[first + i];
      });
      book.moments[k] = { ...moments[from], poses: [k] };
    });
    Object.assign(timeline, { moments: book.moments, runs: runsOf(book.moments), last: book.moments.length - 1 });
    byId("slider").max = timeline.last;
  }
}

/** Ask for news, put them on the page, and ask again until the plan is there. */
extensions.push((app) => {
  const growing = new Growing(app), note = element("div", "", { id: "news", class: "controls", role: "status" });
  const follow = toggle("Follow", () => {}, { title: "Show each pose as it is solved" });
  const text = element("span");
  note.append(text, follow);
  byId("wide").append(note);
  byId("chart").style.display = "none"; // curves belong to the verdict, as does its mark
  growing.drape.dom.head.querySelector(".answer").classList.remove("good");
  follow.set(true);
  const jump = app.timeline.jump.bind(app.timeline);
  app.timeline.jump = (moment) => { follow.set(false); jump(moment); };
  let since = app.book.live, latest = app.timeline.last, failed = 0;
  const ask = async () => {
    const answer = await fetch(`news?since=${since}`);
    if (!answer.ok) throw new Error(answer.statusText);
    const news = await answer.json();
    failed = 0;
    if (news.payload) {
      const { book, view } = await unpack(news.payload);
      growing.put(book.places, book.drape, view, book.moments);
      latest = book.places.at(-1);
    }
    since = document.body.dataset.since = news.since; // once its poses are there
    if (follow.getAttribute("aria-pressed") === "true") app.show(latest);
    else if (news.payload) app.show(app.pose);
    text.textContent = news.text;
    if (news.ended === "plan") return location.reload();
    if (!news.ended) setTimeout(() => ask().catch(retry), news.payload ? 0 : ASK);
  };
  const retry = () => {
    if (++failed < TRIES) return setTimeout(() => ask().catch(retry), ASK);
    text.textContent = "The planner has stopped.";
  };
  setTimeout(() => ask().catch(retry), 0);
});
