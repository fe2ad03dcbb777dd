"""What tests of the commands share: errors are expected by their code and values."""

import pytest
from refusals import assert_names


@pytest.fixture
def check_error():
    """Check that a command reported an error: exit status, and one line with the values and the code.

    Called with the result of the run, the :class:`~jitterkit.errors.ErrorCode` and the values that the line
    must name in this order: file, option, number.  The line ends with the code in brackets.
    """

    def check(done, code, *values, status=2):
        assert done.exit_code == status, done.output
        (line,) = [line for line in done.stderr.splitlines() if line.startswith("jitterkit: ")]
        assert line.endswith(f" [{code}]"), line
        assert_names(line, values)
        assert "Traceback" not in done.output

    return check
