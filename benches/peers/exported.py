"""Holds onnxruntime to the tape: every exported network, checked by onnx and run at batches of one and three.

    pip install onnx onnxruntime numpy
    ONNX_FOLDER=/tmp/networks cargo test -p unsphere-benches --features onnx --test exported
    python benches/peers/exported.py /tmp/networks

Prints for each network the largest difference from the tape as a share of the range of the numbers, and fails above 1e-5.
"""

import json
import pathlib
import sys

import numpy as np
import onnx
import onnxruntime

LIMIT = 1e-5


def worst(folder):
    """The largest share over the outputs of one network at one batch."""
    listed = json.loads((folder / "arrays.json").read_text())
    arrays = {
        (entry["kind"], entry["name"]): np.fromfile(folder / entry["file"], "<f4").reshape(entry["shape"])
        for entry in listed
    }
    model = onnx.load(folder / "model.onnx")
    onnx.checker.check_model(model, full_check=True)
    assert [opset.version for opset in model.opset_import] == [17]
    session = onnxruntime.InferenceSession(folder / "model.onnx", providers=["CPUExecutionProvider"])
    given = {name: array for (kind, name), array in arrays.items() if kind == "in"}
    names = [output.name for output in session.get_outputs()]
    share = 0.0
    for name, found in zip(names, session.run(names, given)):
        expected = arrays["out", name]
        assert found.shape == expected.shape, (folder.name, name, found.shape, expected.shape)
        share = max(share, float(np.abs(found - expected).max() / np.abs(expected).max()))
    return share


def main():
    folders = sorted(pathlib.Path(sys.argv[1]).iterdir())
    shares = {folder.name: worst(folder) for folder in folders}
    for name, share in shares.items():
        print(f"{name:28} {share:.1e}{'  TOO FAR' if share > LIMIT else ''}")
    print(f"{len(shares)} networks and batches, at most {max(shares.values()):.1e}; "
          f"onnx {onnx.__version__}, onnxruntime {onnxruntime.__version__}")
    sys.exit(max(shares.values()) > LIMIT)


if __name__ == "__main__":
    main()
