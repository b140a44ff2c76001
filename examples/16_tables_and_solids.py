"""Tables for other programs and solids to print: CSV and Parquet with units in the headings, STL, 3MF, glTF."""

import sys
import tempfile
from pathlib import Path

import mechviz as mv
from mechviz.outputs.exports.gltf import export_glb
from mechviz.outputs.exports.solids import export_3mf, export_stl
from mechviz.outputs.exports.tables import even_times, export_csv, export_parquet

folder = Path(sys.argv[1] if len(sys.argv) > 1 else tempfile.mkdtemp())

result = mv.run("crank-rocker", frames=60)
run = result.solved
export_csv(run, folder / "frames.csv")
export_parquet(run, folder / "every-millisecond.parquet", even_times(run, 1e-3))  # also between the frames
export_stl(run, folder / "parts")  # one file a link, in millimetres
export_3mf(run, folder / "parts.3mf")
export_glb(result.presentation, folder / "moving.glb")

for path in sorted(folder.rglob("*.*")):
    print(f"{path.stat().st_size:>9,} bytes  {path.relative_to(folder)}")
