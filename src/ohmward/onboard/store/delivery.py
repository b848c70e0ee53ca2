"""Delivery to a server through a spool: states in, batches out, again and again while the server is away."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from ohmward.errors import OhmwardError
from ohmward.onboard.feed import Feed
from ohmward.onboard.part import LOG
from ohmward.onboard.robot_state import RobotState
from ohmward.onboard.store.rows import Row, RowMaker
from ohmward.onboard.store.spool import Spool

#: Rows that are sent at once.
ROWS_AT_ONCE = 5000

#: Rows that wait at most: a day at 10 Hz, some 300 MB.
MOST_WAITING = 1_000_000

#: Time between two looks into the feed, so that commits are few.
GATHER_S = 0.5

#: Pauses after a failure [s]: doubled each time.
FIRST_PAUSE_S, LONGEST_PAUSE_S = 0.5, 30.0

#: Takes rows to the server and returns once it has confirmed them; raises OhmwardError where it has not.
Send = Callable[[Sequence[Row]], None]


async def deliver(feed: Feed, send: Send, path: Path, most_waiting: int = MOST_WAITING) -> None:
    """Deliver the states of a feed until it ends; what could not be delivered stays on the disk.

    send: called in a thread.  path: of the spool.
    """
    spool, maker = await asyncio.to_thread(Spool, path, most_waiting), RowMaker()
    sender = asyncio.create_task(_send_all(spool, send, feed))
    try:
        while states := await feed.batch():
            rows = [row for state in states for row in maker.rows(state)]
            await until_taken(partial(spool.put, rows), feed, states)
            feed.lost += spool.left_out()
            await asyncio.sleep(0.0 if feed.ended else GATHER_S)
        await asyncio.to_thread(_send_rest, spool, send)
    finally:
        sender.cancel()
        await asyncio.gather(sender, return_exceptions=True)
        spool.close()


async def until_taken(take: Callable[[], None], feed: Feed, states: list[RobotState]) -> None:
    """Try again and again in a thread, until the disk takes what it refuses; states wait in the feed meanwhile.

    states: go back to the feed where it has ended.

    Raises:
        OhmwardError: the disk refuses and the feed has ended.
    """
    refused = False
    while True:
        try:
            await done_in_thread(take)
            feed.trouble = "" if refused else feed.trouble
            return
        except OhmwardError as error:
            if feed.ended:
                feed.put_back(states)
                raise
            refused, feed.trouble = True, str(error)
            await asyncio.sleep(FIRST_PAUSE_S)


async def done_in_thread(work: Callable[[], None]) -> None:
    """Do work in a thread; who cancels it waits until it is done, and may then close what it worked on."""
    task = asyncio.ensure_future(asyncio.to_thread(work))
    try:
        await asyncio.shield(task)
    except asyncio.CancelledError:
        await asyncio.wait([task])
        raise


async def _send_all(spool: Spool, send: Send, feed: Feed) -> None:
    """Send what waits, for ever; a server that is away is tried again after a while."""
    pause_s = FIRST_PAUSE_S
    while True:
        if not spool.waiting:
            await asyncio.sleep(GATHER_S)
            continue
        try:
            await asyncio.to_thread(send_batch, spool, send)
            pause_s, feed.trouble = FIRST_PAUSE_S, ""
        except Exception as error:
            feed.trouble = f"rows wait on the disk: {error}"
            await asyncio.sleep(pause_s)
            pause_s = min(2.0 * pause_s, LONGEST_PAUSE_S)


def _send_rest(spool: Spool, send: Send) -> None:
    """Send what waits at the end, as far as the server takes it."""
    try:
        while spool.waiting:
            send_batch(spool, send)
    except Exception as error:
        LOG.warning("%d rows stay on the disk for the next start: %s", spool.waiting, error)


def send_batch(spool: Spool, send: Send) -> None:
    """Send the oldest rows and forget them once they are confirmed."""
    with spool.sending:
        number, rows = spool.oldest(ROWS_AT_ONCE)
        if rows:
            send(rows)
            spool.confirm(number)
