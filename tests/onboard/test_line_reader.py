"""Lines of a connection: whole, cut anywhere, too long, in bursts."""

import asyncio
import random
from itertools import pairwise

from ohmward.onboard.line_reader import LINES_AT_ONCE, LONGEST_LINE, LineReader


class Link(asyncio.Transport):
    """A connection that notes whether it is read."""

    def __init__(self):
        super().__init__()
        self.reads, self.pauses = True, 0

    def pause_reading(self):
        self.reads, self.pauses = False, self.pauses + 1

    def resume_reading(self):
        self.reads = True


def read(pieces, error=None):
    """Lines, number of those left out, ends and the link after the pieces have come."""

    async def main():
        lines: list[bytes] = []
        left_out: list[int] = []
        ends: list[Exception | None] = []
        link = Link()
        reader = LineReader(lines.append, lambda: left_out.append(1), ends.append)
        reader.connection_made(link)
        for piece in pieces:
            reader.data_received(piece)
        reader.connection_lost(error)
        while not ends:
            await asyncio.sleep(0)
        return lines, len(left_out), ends, link

    return asyncio.run(main())


def test_lines_may_be_cut_anywhere():
    data, rng = b"".join(b"%d\n" % k for k in range(500)) + b"rest", random.Random(1)
    cuts = [0, *sorted(rng.sample(range(len(data)), 60)), len(data)]
    lines, left_out, ends, _ = read([data[a:b] for a, b in pairwise(cuts)])
    assert lines == [*(b"%d" % k for k in range(500)), b"rest"]
    assert left_out == 0
    assert ends == [None]


def test_a_line_that_is_too_long_is_left_out_once():
    pieces = [b"good\n", *[b"x" * 1000] * (3 * LONGEST_LINE // 1000), b"x\ngood", b"\n", b"y" * (LONGEST_LINE + 1)]
    lines, left_out, _, _ = read(pieces)
    assert lines == [b"good", b"good"]
    assert left_out == 2


def test_a_line_that_is_too_long_is_left_out_also_where_it_comes_at_once():
    lines, left_out, _, _ = read([b"good\n" + b"x" * (LONGEST_LINE + 1) + b"\ngood\n"])
    assert (lines, left_out) == ([b"good", b"good"], 1)


def test_others_have_their_turn_in_a_burst():
    async def main():
        lines: list[bytes] = []
        ends: list[Exception | None] = []
        link = Link()
        reader = LineReader(lines.append, lambda: None, ends.append)
        reader.connection_made(link)
        reader.data_received(b"line\n" * 10 * LINES_AT_ONCE)
        assert len(lines) == LINES_AT_ONCE
        assert not link.reads
        turns = 0
        while not link.reads:
            await asyncio.sleep(0)
            turns += 1
        assert turns == 9
        assert len(lines) == 10 * LINES_AT_ONCE
        assert link.pauses == 1

    asyncio.run(main())


def test_the_error_that_ended_it_is_told_after_the_last_line():
    error = ConnectionResetError("gone")
    lines, _, ends, _ = read([b"a\n" * 3 * LINES_AT_ONCE], error)
    assert len(lines) == 3 * LINES_AT_ONCE
    assert ends == [error]
