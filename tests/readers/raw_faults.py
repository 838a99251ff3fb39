"""What tests of wrong raw runs share: the refusal of a folder, and datasets with some values replaced."""

from __future__ import annotations

import pytest

from deform.errors import InputError
from deform.readers.raw_folder import read_raw_folder


def refused(folder) -> str:
    """Return what the reader says, which must be an InputError."""
    with pytest.raises(InputError) as caught:
        read_raw_folder(folder)
    assert all(f.where.startswith("tiny") for f in caught.value.faults)
    return str(caught.value)


def changed(ds, **variables):
    """Return the dataset with the values of some variables replaced."""
    return ds.assign({name: (ds[name].dims, values, ds[name].attrs) for name, values in variables.items()})


def stamped(ds, at, value):
    """Return the dataset with one time stamp replaced."""
    time = ds["time"].values.copy()
    time[at] = value
    return changed(ds, time=time)
