"""Numbers that are chosen by measurement."""


class Tuned:
    """Base of the frozen classes that hold such numbers, one class a module, its instance named ``TUNED``.

    The measurements behind them are tables in ``docs/calibration``; ``python benchmarks/calibrate.py`` renews a table.
    """
