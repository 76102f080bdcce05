"""`crosspih recording`: look into recordings, mend, cut and merge them, and hand them to other programs."""

import typer

from services.operator.export import export_app
from services.operator.recording.commands import check, cut, info, merge, recover

recording_app = typer.Typer(no_args_is_help=True, help="Look into recordings, mend, cut, merge and export them.")
for _command in (info, check, recover, cut, merge):
    recording_app.command()(_command)
recording_app.add_typer(export_app, name="export")
