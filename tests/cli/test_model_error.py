"""How a model error is given on the command line."""

from refusals import refused

from jitterkit.cli.options import parse_model_error
from jitterkit.errors import ErrorCode


def test_a_model_error_is_a_number_or_auto():
    assert parse_model_error("0.02") == 0.02
    assert parse_model_error("auto") == "auto"
    with refused(ErrorCode.MALFORMED, "2%"):
        parse_model_error("2%")
