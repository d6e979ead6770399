// What the page holds: a manifest in JSON, and its numbers as compressed bytes.

const manifest = JSON.parse(document.getElementById("manifest").textContent);
const LEVELS = 65535; // see cosim/report/packing.py

async function unpacked(id) {
  const letters = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

let plotlyIsLoading = null;

/** The plotting library is unpacked when the first of its plots comes near the window. */
function loadPlotly() {
  plotlyIsLoading ??= unpacked("plotly").then((bytes) => {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(bytes);
    document.head.append(script);
  });
  return plotlyIsLoading;
}

/** The columns, setups and builds as typed arrays; `numbers` is the block of bytes. */
function opened(numbers) {
  const count = manifest.setups;
  const doubles = (at, length = count) => new Float64Array(numbers, at, length);
  const columns = manifest.columns.map((column) => {
    const values = doubles(column.at), span = column.high - column.low || 1;
    const { doubt } = column;
    const known = doubt && Object.fromEntries(["spread", "best", "baseline", "tied"].map((key) => [key, doubles(doubt[key])]));
    return { ...column, values, doubt: known, ties: doubt?.ties, levels: Float64Array.from(values, (value) => (value - column.low) / span) };
  });
  const placed = manifest.corners.map((_, corner) => Uint8Array.from(doubles(manifest.placed[corner])));
  return { count, columns, placed, numbers: doubles(manifest.numbers), rank: doubles(manifest.rank),
    allowed: doubles(manifest.allowed), error: doubles(manifest.error), bytes: numbers };
}

/** The samples of a channel in SI: 16-bit differences of levels. */
function samples(channel, count) {
  const steps = new Uint16Array(data.bytes, channel.at, count), values = new Float64Array(count);
  for (let k = 0, level = 0; k < count; k++) {
    level = (level + steps[k]) & LEVELS;
    values[k] = channel.low + (channel.high - channel.low) * (level / LEVELS);
  }
  return values;
}
