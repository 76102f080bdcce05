"""Running a supervisor in this process, until it is told to stop or has nothing left to run."""

import asyncio
import signal
from collections.abc import Callable

from crosspih_common.modules import DATA_VARIABLE, data_folder
from deploy.launcher.errors import LauncherError
from deploy.launcher.logfile import LogLine
from deploy.launcher.stack import StackRequest
from deploy.launcher.supervisor import Supervisor


def _make_data_folder() -> None:
    folder = data_folder()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LauncherError(f"{folder}: no folder can be made there ({error.strerror}); mend {DATA_VARIABLE}") from None


def supervise(request: StackRequest, show: Callable[[LogLine], None], whole: bool = False) -> int:
    """Run a stack here; ``show`` gets every line its services write. Returns the exit status to end with. ``whole``: it
    ends as a whole where one of its services cannot read its settings.

    SIGINT (Ctrl-C), SIGTERM and SIGHUP stop it in order, a second one kills what is left. Raises ComposeError and
    AlreadyUpError.
    """
    services = request.chosen()
    _make_data_folder()
    directory = request.directory()
    directory.acquire()

    async def run() -> int:
        supervisor = Supervisor(services, request.compose_file, directory, show, request.stop_timeout_s, whole)
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, supervisor.stop)
        return await supervisor.run()

    try:
        return asyncio.run(run())
    finally:
        state = directory.read()
        directory.release(keep_state=state is not None and state.finished)
