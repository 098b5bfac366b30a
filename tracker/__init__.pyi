# The types of what `tracker` offers by itself.
from tracker.foundation.errors import TrackerError as TrackerError
from tracker.results.result import Result as Result
from tracker.results.result import Track as Track
from tracker.results.result import load_result as load_result
from tracker.running.programs import Run as Run
from tracker.running.programs import evaluate as evaluate
from tracker.running.programs import export as export
from tracker.running.programs import load_run as load_run
from tracker.running.programs import simulate as simulate
from tracker.running.programs import smooth as smooth

__version__: str
