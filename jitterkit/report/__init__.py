"""What a run leaves behind: a table, a summary, pictures and a page that shows them.

Reach for :mod:`~jitterkit.report.table` to turn fits into ``results.ecsv`` and back, for
:mod:`~jitterkit.report.summary` to combine its frames, for :mod:`~jitterkit.report.plots` to draw on
your own axes, for :mod:`~jitterkit.report.pictures` to keep one fitted frame as a picture while the
run streams on, and for :mod:`~jitterkit.report.html` to bind all of it into one file.  Nothing is
imported here: the table is read without matplotlib, and all of it without JAX.
"""
