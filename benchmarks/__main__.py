"""Run every benchmark, or the ones named: ``python -m benchmarks [NAME ...]``."""

from __future__ import annotations

import importlib
import pkgutil
import sys

import benchmarks


def main(names: list[str]) -> int:
    """Run the named benchmarks, default all; return how many could not run."""
    known = sorted(m.name for m in pkgutil.iter_modules(benchmarks.__path__) if not m.name.startswith("_"))
    unknown = [n for n in names if n not in known]
    if unknown:
        print(f"no benchmark {', '.join(unknown)}; there are {', '.join(known)}")
        return 2
    failed = 0
    for name in names or known:
        print(f"\n== {name}", flush=True)
        sys.argv = [name]  # a benchmark reads its own options; here it runs with its defaults
        try:
            importlib.import_module(f"benchmarks.{name}").main()
        except ImportError as absent:
            failed += 1
            print(f"not run: {absent}; install what is absent and run again")
    return failed


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
