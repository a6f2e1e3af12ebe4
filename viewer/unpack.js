/* Payload of the page: see packing.py for its layout. */

/** Take apart base64(gzip(header length | header | arrays)). */
async function unpack(text) {
  const packed = Uint8Array.from(atob(text.trim()), (c) => c.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  const buffer = await new Response(stream).arrayBuffer();
  const length = new DataView(buffer).getUint32(0, true);
  const book = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
  const body = 8 * Math.ceil((4 + length) / 8);
  const view = (Type, index) => {
    const [offset, size] = book.blobs[index];
    return new Type(buffer, body + offset, size / Type.BYTES_PER_ELEMENT);
  };
  return { book, view };
}

/** Undo packing.fold: unsigned numbers of shape (channels, poses, rows, columns). */
function unfold(bytes, Type, channels, poses, rows, columns) {
  const n = channels * poses * rows * columns;
  const values = new Type(n);
  for (let i = 0; i < n; i++) {
    const folded = Type === Uint16Array ? bytes[i] | (bytes[n + i] << 8) : bytes[i];
    values[i] = (folded >>> 1) ^ -(folded & 1);
  }
  const pose = rows * columns;
  for (let row = 0; row < n; row += columns)
    for (let j = 1; j < columns; j++) values[row + j] += values[row + j - 1];
  for (let first = 0; first < n; first += pose)
    for (let i = columns; i < pose; i++) values[first + i] += values[first + i - columns];
  for (let first = 0; first < n; first += poses * pose)
    for (let i = pose; i < poses * pose; i++) values[first + i] += values[first + i - pose];
  return values;
}

/** Positions that change from pose to pose; `read(k, out)` fills out with pose k. */
class Track {
  constructor(entry, view) {
    this.count = entry.rows * entry.columns;
    this.poses = entry.poses;
    this.step = entry.step;
    this.origin = view(Float64Array, entry.origin);
    this.steps = unfold(
      view(Uint8Array, entry.steps), Uint16Array, 3, entry.poses, entry.rows, entry.columns);
  }

  read(k, out) {
    const { count, poses, step, steps, origin } = this;
    for (let c = 0; c < 3; c++) {
      const low = origin[3 * k + c], first = (c * poses + k) * count;
      for (let i = 0; i < count; i++) out[3 * i + c] = low + step * steps[first + i];
    }
    return out;
  }
}
