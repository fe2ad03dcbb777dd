"""Commands over many files: a run and its table, a watch of a directory, a table of kernel estimates.

A run plans batches, has an executor process them (:mod:`jitterkit.batch`), keeps what comes of each frame in
the store, and writes table, summary and report (:mod:`jitterkit.report`).
"""

from jitterkit.run.process import Run, process_files
