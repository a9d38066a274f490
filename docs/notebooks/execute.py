"""Execute the notebooks and store what they show: `python docs/notebooks/execute.py [--check] [NOTEBOOK …]`.

Each runs from top to bottom in an empty folder. With --check nothing is stored: it fails where a cell raises or warns,
or where what it prints is not what is stored, digits aside, as another version of NumPy may draw other numbers.
"""

from __future__ import annotations

import argparse
import base64
import io
import os
import re
import sys
import tempfile
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from PIL import Image
from traitlets.config import Config

HERE = Path(__file__).resolve().parent
SECONDS = 300
"""How long one cell may take on a slow and busy machine."""


def execute(path: Path) -> nbformat.NotebookNode:
    """The notebook with what its cells show now; raises what a cell raises."""
    notebook = nbformat.read(path, as_version=4)
    os.environ["OPENBLAS_NUM_THREADS"] = "1"  # small matrices, on a machine that may be busy
    with tempfile.TemporaryDirectory() as folder:
        # What the kernel keeps of itself goes there too, not into the home; sockets of files, not of the network.
        os.environ |= {"IPYTHONDIR": str(Path(folder) / ".ipython"), "JUPYTER_RUNTIME_DIR": str(Path(folder) / ".run")}
        NotebookClient(
            notebook,
            timeout=SECONDS,
            record_timing=False,
            coalesce_streams=True,
            resources={"metadata": {"path": folder}},
            config=Config(KernelManager={"transport": "ipc", "ip": str(Path(folder) / "kernel")}),
        ).execute()
    for output in shown(notebook):
        if "image/png" in output.get("data", {}):
            output.data["image/png"] = smaller(output.data["image/png"])
    notebook.metadata = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python", "pygments_lexer": "ipython3"},
    }
    return notebook


def shown(notebook: nbformat.NotebookNode) -> list[nbformat.NotebookNode]:
    """All outputs of all cells."""
    return [output for cell in notebook.cells for output in cell.get("outputs", [])]


def smaller(png: str) -> str:
    """The same picture in 128 colours, a third of the size; the package's plots have few."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB").quantize(128, dither=Image.Dither.NONE)
    buffer = io.BytesIO()
    picture.save(buffer, format="png", optimize=True)
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def words(notebook: nbformat.NotebookNode) -> list[str]:
    """What each cell of code prints, digits aside, and which kinds of output follow."""
    found = []
    for cell in notebook.cells:
        if cell.cell_type == "code":
            text = "".join(output.get("text", "") for output in cell.outputs)
            kinds = [kind for output in cell.outputs for kind in sorted(output.get("data", {}))]
            found.append(" ".join([_shape(text), *kinds]))
    return found


def _shape(text: str) -> str:
    """Words in their order: a number may be longer, or have a sign or an exponent, than it had."""
    return " ".join(re.sub(r"[-+]?\d[\d.,]*(e[-+]?\d+)?", "0", text).split())


def faults(notebook: nbformat.NotebookNode) -> list[str]:
    """Warnings among what it shows."""
    return [output.text for output in shown(notebook) if output.get("name") == "stderr"]


def main(arguments: list[str] | None = None) -> int:
    """Execute; store, or compare with what is stored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("notebooks", nargs="*", type=Path, help="all beside this file by default")
    parser.add_argument("--check", action="store_true", help="store nothing; fail where it shows something else")
    options = parser.parse_args(arguments)
    wrong = 0
    for path in options.notebooks or sorted(HERE.glob("*.ipynb")):
        now = execute(path)
        for text in faults(now):
            print(f"{path.name} warns: {text}", file=sys.stderr)
            wrong = 1
        if options.check:
            stored = words(nbformat.read(path, as_version=4))
            for before, after in zip(stored, words(now), strict=True):
                if before != after:
                    print(f"{path.name} showed\n{before}\nand now shows\n{after}", file=sys.stderr)
                    wrong = 1
        else:
            nbformat.write(now, path)
            print(f"wrote {path.name}, {path.stat().st_size / 1e3:.0f} kB")
    return wrong


if __name__ == "__main__":
    sys.exit(main())
