"""Where a playback stands, and how fast it goes on."""

from __future__ import annotations


class Player:
    """A place in a recording, 0 to its duration, that moves on while it plays, and begins again at the end."""

    def __init__(self, duration_s: float) -> None:
        """Stand still at the start.

        Args:
            duration_s: Of the recording, s, above 0.

        """
        self.duration_s = duration_s
        self.time_s = 0.0
        self.speed = 1.0
        """Recorded time per real time."""
        self.playing = False

    def go_on(self, real_s: float) -> None:
        """Let real time pass, s."""
        if self.playing:
            self.jump((self.time_s + self.speed * real_s) % self.duration_s)

    def jump(self, time_s: float) -> None:
        """Stand at a time, s, or at the end that is nearest to it."""
        self.time_s = min(max(time_s, 0.0), self.duration_s)
