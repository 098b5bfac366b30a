# The types of what `tracker` offers by itself.
from tracker.errors import TrackerError as TrackerError
from tracker.person_track import Track as Track
from tracker.programs import evaluate as evaluate
from tracker.programs import export as export
from tracker.programs import simulate as simulate
from tracker.programs import smooth as smooth
from tracker.result import Result as Result
from tracker.result import load_result as load_result
from tracker.run import Run as Run
from tracker.run import load_run as load_run

__version__: str
