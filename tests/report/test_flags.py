from jitterkit.report.flags import FLAGS, decode_flags, encode_flags, flag_meanings


def test_every_remark_has_a_bit_of_its_own_and_comes_back():
    codes = [encode_flags([word]) for word in FLAGS]
    assert codes == [1 << bit for bit in range(len(FLAGS))]
    assert [decode_flags(code) for code in codes] == [(word,) for word in FLAGS]
    assert decode_flags(encode_flags(FLAGS)) == tuple(FLAGS)


def test_the_first_bits_never_change_since_old_tables_hold_them():
    assert list(FLAGS)[:5] == ["other", "saturated", "jitter_undetected", "misfit", "degenerate"]


def test_a_remark_without_a_bit_counts_as_other_and_a_bit_without_a_remark_is_skipped():
    assert decode_flags(encode_flags(["haunted", "saturated"])) == ("other", "saturated")
    assert decode_flags(1 << 40) == ()


def test_the_meanings_decode_a_column_without_this_package():
    meanings = flag_meanings()
    assert meanings[encode_flags(["saturated"])].startswith("saturated: ")
