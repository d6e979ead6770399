// The data of the page: a manifest in JSON, and the numbers as compressed bytes.

const manifest = JSON.parse(document.getElementById("manifest").textContent);

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
