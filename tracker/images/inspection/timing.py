"""Views out of step: one view shows the same movement earlier or later than the others."""

from __future__ import annotations

from collections.abc import Iterator

from tracker.foundation.configuration.components import component
from tracker.images.inspection import Survey, changes


@component
class TimingInspection:
    """Planes through two cameras touch the foregrounds of both at the same angles, at the same time.

    Delays that `reading.in_step` corrects do not appear here. See `tracker.images.inspection._delays`.
    """

    def findings(self, seen: Survey) -> Iterator[str]:
        """See `tracker.images.inspection.Inspection.findings`."""
        found = seen.delays
        for v, name in enumerate(seen.rig.names):
            late = changes(seen, v)
            if len(late) > 1:
                told = ", ".join(f"{images:+d} from frame {frame} on" for frame, images in late.items())
                yield (
                    f'view "{name}" drops or repeats images, or its clock runs at another rate: it looks late by '
                    f"{told} images: try offsets = {{ {name} = {[list(one) for one in late.items()]} }} in [reading], "
                    "added to what stands there"
                )
            elif images := next(iter(late.values()), 0):
                yield (
                    f'view "{name}" looks {abs(images)} image{"s" * (abs(images) > 1)} '
                    f"{'late' if images > 0 else 'early'} against the others: try offsets = {{ {name} = {images} }} in "
                    "[reading], added to what stands there"
                )
            if part := float(found.part[v]):
                yield (
                    f'view "{name}" looks {abs(part):.1f} frames {"late" if part > 0 else "early"} against the others, '
                    "which whole frames cannot correct: the persons tell how much, and poses are brought to one moment "
                    "by the run, or by bodytrack result align RESULT"
                )
