// The data of the page: a manifest in JSON, and the numbers as compressed bytes.

const manifest = JSON.parse(document.getElementById("manifest").textContent);
const LEVELS = 65535; // see cosim/report/packing.py

async function unpack(id) {
  const letters = atob(document.getElementById(id).textContent.trim());
  const bytes = new Uint8Array(letters.length);
  for (let k = 0; k < bytes.length; k++) bytes[k] = letters.charCodeAt(k);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

let plotlyIsLoading = null;

/** Load the plotting library when the first of its plots comes near the window. */
function loadPlotly() {
  plotlyIsLoading ??= unpack("plotly").then((bytes) => {
    const script = document.createElement("script");
    script.textContent = new TextDecoder().decode(bytes);
    document.head.append(script);
  });
  return plotlyIsLoading;
}

/** Return the columns, setups and builds as typed arrays; `numbers` is the block of bytes. */
function decode(numbers) {
  const count = manifest.setups;
  const doubles = (at, length = count) => new Float64Array(numbers, at, length);
  const columns = manifest.columns.map((column) => {
    const values = doubles(column.at), span = column.high - column.low || 1;
    const { uncertainty } = column;
    const known = uncertainty && Object.fromEntries(["spread", "best", "baseline", "tied"].map((key) => [key, doubles(uncertainty[key])]));
    return { ...column, values, uncertainty: known, ties: uncertainty?.ties, levels: Float64Array.from(values, (value) => (value - column.low) / span) };
  });
  const placed = manifest.corners.map((_, corner) => Uint8Array.from(doubles(manifest.placed[corner])));
  return { count, columns, placed, numbers: doubles(manifest.numbers), rank: doubles(manifest.rank),
    allowed: doubles(manifest.allowed), error: doubles(manifest.error), bytes: numbers };
}

/** Return the samples of a channel in SI; they are stored as 16-bit differences of levels. */
function samples(channel, count) {
  const steps = new Uint16Array(data.bytes, channel.at, count), values = new Float64Array(count);
  for (let k = 0, level = 0; k < count; k++) {
    level = (level + steps[k]) & LEVELS;
    values[k] = channel.low + (channel.high - channel.low) * (level / LEVELS);
  }
  return values;
}
