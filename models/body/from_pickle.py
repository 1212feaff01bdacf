"""An SMPL-format pickle to the npz that edgecap reads: python from_pickle.py MODEL.pkl MODEL.npz.  Needs numpy, and scipy for sparse regressors.

A pickle is a program: only names of NumPy, SciPy's sparse matrices and chumpy are let in, and chumpy's arrays become plain ones.
"""

from __future__ import annotations

import pickle
import sys

import numpy as np

FIELDS = ("v_template", "f", "shapedirs", "posedirs", "weights", "kintree_table")
# What arrays and sparse matrices are pickled as; anything else of these modules could run commands.
MODULES = ("numpy", "scipy.sparse", "_codecs")
NAMES = {"_reconstruct", "scalar", "ndarray", "dtype", "csc_matrix", "csr_matrix", "coo_matrix", "encode"}


class Chumpy:
    """Stands for any of chumpy's arrays; what it holds is in `x`."""

    def __init__(self, *args: object, **kwargs: object):
        self.x = args[0] if args else None

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)

    def __array__(self, dtype: object = None, copy: object = None) -> np.ndarray:
        x = np.asarray(self.__dict__.get("x", self.__dict__.get("a")))
        if "idxs" in self.__dict__:  # a selection of another array
            x = np.asarray(self.__dict__["a"]).ravel()[np.asarray(self.__dict__["idxs"])]
            if "preferred_shape" in self.__dict__:
                x = x.reshape(self.__dict__["preferred_shape"])
        return x if dtype is None else x.astype(dtype)


class Careful(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> object:
        if module.split(".")[0] == "chumpy":
            return Chumpy
        if name in NAMES and any(module == m or module.startswith(f"{m}.") for m in MODULES):
            return super().find_class(module, name)
        raise SystemExit(f"expected arrays of numpy, scipy.sparse or chumpy, found {module}.{name}: this is not a body model, or not only one")


def main(source: str, out: str) -> None:
    with open(source, "rb") as f:
        model = Careful(f, encoding="latin1").load()
    missing = [k for k in (*FIELDS, "J_regressor") if k not in model and k != "posedirs"]
    if missing:
        raise SystemExit(f"expected SMPL's fields in {source}, found none named {', '.join(missing)}")
    arrays = {k: np.asarray(model[k]) for k in FIELDS if k in model}
    regressor = model["J_regressor"]
    if hasattr(regressor, "tocsr"):
        rows = regressor.tocsr()
        arrays |= {f"J_regressor_{k}": np.asarray(getattr(rows, k)) for k in ("data", "indices", "indptr")}
    else:
        arrays["J_regressor"] = np.asarray(regressor)
    np.savez_compressed(out, **{k: v.astype(np.float32) if v.dtype.kind == "f" else v for k, v in arrays.items()})


if __name__ == "__main__":
    if len(sys.argv) != 3:
        raise SystemExit(__doc__)
    main(*sys.argv[1:])
