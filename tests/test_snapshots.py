"""What tests stand on: the same text, and the same examples of properties in any process."""

import pytest

from tests.snapshots import close


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ("rms 1.234 deg", "rms 1.235 deg", True),
        ("rms 1.234 deg", "rms 1.236 deg", False),
        ("rms 1.234 deg", "rms 1.234 rad", False),
        ("0.123456789012", "0.123456789999", True),
        ("0.12345678", "0.12346678", False),
        ("1e-12", "0.0", True),
        ("24 samples", "25 samples", False),
        ("-0.000 deg", "0.000 deg", True),
    ],
)
def test_words_agree_to_the_letter_and_numbers_up_to_rounding(first, second, same):
    assert close(first, second) is same
