"""The command line of `mesotap`. Each command only says what it takes; the work is imported when it is called."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mesotap.cli_campaigns import ClusterSite
from mesotap.cli_campaigns import commands as campaign_commands
from mesotap.cli_catalogue import commands as catalogue_commands
from mesotap.cli_options import Changes, ConfigPath, JsonPath
from mesotap.cli_options import console as _console
from mesotap.cli_plugins import commands as plugin_commands

app = typer.Typer(
    name="mesotap",
    help="Contact stiffness and damping from contact resonance: run the tester, analyse sessions, write the report.",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    context_settings={"max_content_width": 110, "help_option_names": ["--help", "-h"]},
)
config_app = typer.Typer(help="Check, show or start a config.yaml.", no_args_is_help=True)
app.add_typer(config_app, name="config")
rig_app = typer.Typer(help="Begin or check the description of a rig other than the tester.", no_args_is_help=True)
app.add_typer(rig_app, name="rig")
certificate_app = typer.Typer(
    help="Write or check a digital calibration certificate of the strain gauge.", no_args_is_help=True
)
app.add_typer(certificate_app, name="certificate")


def _one_rig(context: typer.Context, option: typer.CallbackParam, given: bool) -> bool:
    """Refuse the second of two rigs."""
    if given and context.params.get("emulate" if option.name == "simulate" else "simulate"):
        raise typer.BadParameter("--simulate and --emulate name two rigs; give one of them")
    return given


Simulate = Annotated[
    bool, typer.Option("--simulate", callback=_one_rig, help="Use the simulated rig instead of the real one.")
]
Emulate = Annotated[
    bool,
    typer.Option(
        "--emulate",
        callback=_one_rig,
        help="Use the drivers with emulated devices, which the simulated rig stands behind.",
    ),
]
Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, help="Seed of the simulated rig, instead of the one configured.", show_default=False),
]
RecordWire = Annotated[
    Path | None,
    typer.Option(
        "--record-wire",
        metavar="FILE",
        help="Record every byte to and from the devices, with its time, into a new file.",
        show_default=False,
    ),
]
RecordSamples = Annotated[
    bool, typer.Option("--record-samples", help="With --record-wire: all samples too, not only the first second.")
]
LogWire = Annotated[
    bool, typer.Option("--log-wire", "-v", help="Also write every byte to and from the devices into session.log.")
]
Session = Annotated[Path, typer.Argument(help="Session file, or the folder of a session.", show_default=False)]
Report = Annotated[
    Path | None,
    typer.Option("--report", metavar="FOLDER", help="Also write the report into this folder.", show_default=False),
]


def _version(wanted: bool) -> None:
    if wanted:
        from mesotap import __version__

        typer.echo(f"mesotap {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass


@app.command()
def run(
    simulate: Simulate = False,
    config: ConfigPath = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="Folder of the session; sessions/<time> by default.", show_default=False),
    ] = None,
    seed: Seed = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="Let simulated time pass as on the bench.")] = False,
    changes: Changes = None,
    json: JsonPath = None,
    emulate: Emulate = False,
    record_wire: RecordWire = None,
    record_samples: RecordSamples = False,
    log_wire: LogWire = False,
) -> None:
    """Run a test session: calibrate, approach, eight good taps at each load, calibrate again, report.

    Keys: p pauses, q ends safely. However it ended, 'mesotap resume' continues it.
    """
    from mesotap.commands.session import run as begin
    from mesotap.commands.wire_options import WireOptions
    from mesotap.session.order import RigChoice

    wire = WireOptions(record_wire, record_samples, log_wire)
    choice = RigChoice(simulate, emulate, seed, realtime)
    begin(config, changes or (), choice, output, json, _console(json, output), wire)


@app.command()
def resume(
    folder: Annotated[Path, typer.Argument(help="Folder of the session.", show_default=False)],
    json: JsonPath = None,
    record_wire: RecordWire = None,
    record_samples: RecordSamples = False,
    log_wire: LogWire = False,
) -> None:
    """Resume a session that was ended, interrupted or killed; no accepted impact is lost."""
    from mesotap.commands.session import resume as go_on
    from mesotap.commands.wire_options import WireOptions

    go_on(folder, json, _console(json), WireOptions(record_wire, record_samples, log_wire))


@app.command()
def console(
    config: ConfigPath = None,
    simulate: Simulate = False,
    emulate: Emulate = False,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the sessions.", metavar="FOLDER")] = Path(
        "sessions"
    ),
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; 0 takes one that is free.")] = 8642,
    host: Annotated[
        str, typer.Option("--host", help="Address to serve; any but the default is reached by others.")
    ] = "127.0.0.1",
    certfile: Annotated[
        Path | None, typer.Option("--certfile", help="Certificate for TLS (PEM).", show_default=False)
    ] = None,
    keyfile: Annotated[Path | None, typer.Option("--keyfile", help="Its key (PEM).", show_default=False)] = None,
    name: Annotated[
        list[str] | None,
        typer.Option("--name", help="Further name under which others open it.", show_default=False),
    ] = None,
    browser: Annotated[bool, typer.Option("--browser/--no-browser", help="Open the page in the browser.")] = True,
    seed: Seed = None,
    speed: Annotated[
        float,
        typer.Option(
            "--speed", min=0.1, max=1e6, help="How many times faster than on the bench simulated time passes."
        ),
    ] = 1.0,
    changes: Changes = None,
    log_wire: LogWire = False,
    scope: Annotated[
        bool, typer.Option("--scope", help="No session: both accelerometers and the load live, for setting up.")
    ] = False,
    json: JsonPath = None,
) -> None:
    """Run sessions from a page in the browser, on this machine unless --host says otherwise.

    Closing the page changes nothing on the rig; ending the console separates the surfaces, and the session can be
    resumed.
    """
    from mesotap.commands.console import console as serve
    from mesotap.console.server import Address
    from mesotap.session.order import RigChoice

    address = Address(host, port, certfile, keyfile, tuple(name or ()))
    choice = RigChoice(simulate, emulate, seed, simulate or emulate, speed)
    serve(config, tuple(changes or ()), choice, output, address, browser, _console(json), log_wire, scope, json)


@app.command()
def recover(
    folder: Annotated[Path, typer.Argument(help="Folder of a damaged session; it is only read.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Session file to write; FOLDER-recovered.h5 by default.", show_default=False
        ),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Make a valid session file from the intact impacts of a damaged session, and report what was lost."""
    from mesotap.commands.recover import recover_folder

    recover_folder(folder, output, json, _console(json))


@app.command()
def calibrate(
    simulate: Simulate = False,
    config: ConfigPath = None,
    seed: Seed = None,
    changes: Changes = None,
    json: JsonPath = None,
    emulate: Emulate = False,
) -> None:
    """Calibrate the strain gauge with the dead weights, outside a session."""
    from mesotap.commands.alone import calibrate_gauge

    calibrate_gauge(config, changes or (), simulate, seed, json, _console(json), emulate)


@app.command()
def devices(
    simulate: Simulate = False,
    emulate: Emulate = False,
    config: ConfigPath = None,
    seed: Seed = None,
    search: Annotated[
        bool, typer.Option("--search", help="Also look for devices on serial ports that are not configured.")
    ] = False,
    changes: Changes = None,
    json: JsonPath = None,
    record_wire: RecordWire = None,
) -> None:
    """Find what is connected, and say what each configured device answers. Nothing moves.

    That a device gives no answer is an answer (exit code 0); 'mesotap check' fails where one is unfit.
    """
    from mesotap.commands.devices import devices as look
    from mesotap.commands.wire_options import WireOptions

    look(config, changes or (), simulate, emulate, seed, json, _console(json), search, WireOptions(record_wire))


@app.command()
def check(
    simulate: Simulate = False,
    emulate: Emulate = False,
    config: ConfigPath = None,
    seed: Seed = None,
    touch: Annotated[
        bool, typer.Option("--touch/--no-touch", help="Whether the surfaces may be brought together for a tap.")
    ] = True,
    changes: Changes = None,
    json: JsonPath = None,
    record_wire: RecordWire = None,
    record_samples: RecordSamples = False,
) -> None:
    """Test the rig safely, part by part: noise floor, gauge zero, a step of the stage, a tap. One verdict per line."""
    from mesotap.commands.devices import check as test
    from mesotap.commands.wire_options import WireOptions

    wire = WireOptions(record_wire, record_samples)
    test(config, changes or (), simulate, emulate, seed, touch, json, _console(json), wire)


@app.command()
def analyze(
    files: Annotated[
        list[Path], typer.Argument(help="Session files, session folders, or other recordings.", show_default=False)
    ],
    method: Annotated[
        str | None,
        typer.Option("--method", metavar="ml|era", help="Instead of the configured one.", show_default=False),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option("--rate", help="Sampling rate in Hz of a recording that does not say.", show_default=False),
    ] = None,
    config: ConfigPath = None,
    changes: Changes = None,
    report: Report = None,
    json: JsonPath = None,
    model: Annotated[
        Path | None,
        typer.Option(
            "--model",
            metavar="DIAGNOSIS.json",
            help="Also give k_c and zeta2 corrected for what this diagnosis found.",
            show_default=False,
        ),
    ] = None,
    mac: Annotated[
        Path | None,
        typer.Option(
            "--mac",
            metavar="RECORDING",
            help="Also give the modal assurance criterion between the modes of each recording and those of this one.",
            show_default=False,
        ),
    ] = None,
    force: Annotated[
        str | None,
        typer.Option(
            "--force",
            metavar="CHANNEL",
            help="Hammer's channel of a recording; by default the one in N or lbf.",
            show_default=False,
        ),
    ] = None,
    window: Annotated[
        str | None,
        typer.Option(
            "--window",
            metavar="impact|hann|none",
            help="Of its frequency responses; by what it is.",
            show_default=False,
        ),
    ] = None,
    segment: Annotated[
        float | None, typer.Option("--segment", help="Length of what is averaged, in s.", show_default=False)
    ] = None,
    driving_point: Annotated[
        str | None,
        typer.Option(
            "--driving-point",
            metavar="CHANNEL",
            help="Accelerometer on the mass struck: with one on the other, both masses and k_c by the hammer.",
            show_default=False,
        ),
    ] = None,
    clock_ppm: Annotated[
        float | None,
        typer.Option(
            "--clock-ppm",
            min=0.0,
            max=10_000.0,
            help="How far the recorder's clock may be off, plus and minus; 50 unless configured.",
            show_default=False,
        ),
    ] = None,
    decay_from: Annotated[
        float | None,
        typer.Option(
            "--decay-from",
            min=0.0,
            help="Time in s at which the free decay of a recording begins; found by default.",
            show_default=False,
        ),
    ] = None,
) -> None:
    """Find the modes of every impact and k_c and zeta of every load; of any other ring-down, its modes."""
    from mesotap.commands.files import analyze as answer
    from mesotap.commands.force_channel import ForceOptions

    options = ForceOptions(force, window, segment, driving_point)
    shown = _console(json, report)
    answer(files, method, rate, config, changes or (), report, json, shown, model, mac, options, clock_ppm, decay_from)


@app.command()
def report(
    session: Session,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", help="Folder for the report; beside the session by default.", show_default=False
        ),
    ] = None,
    config: ConfigPath = None,
    changes: Changes = None,
    json: JsonPath = None,
) -> None:
    """Write the report of a session, finished or not."""
    from mesotap.commands.files import write_session_report

    write_session_report(session, output, config, changes or (), json, _console(json, output))


@app.command()
def simulate(
    output: Annotated[Path, typer.Argument(help="Session file to write.", show_default=False)],
    load: Annotated[float, typer.Option("--load", min=0.0, help="Preload in mN.")] = 500.0,
    config: ConfigPath = None,
    seed: Seed = None,
    changes: Changes = None,
    json: JsonPath = None,
) -> None:
    """Record one ring-down of the simulated rig into a session file."""
    from mesotap.commands.alone import simulate_one

    simulate_one(config, changes or (), output, load, seed, json, _console(json))


@app.command()
def published(report: Report = None, json: JsonPath = None) -> None:
    """Analyse the paper's Tables 3 and 5 again, and list where its text contradicts itself."""
    from mesotap.commands.published import published as answer

    answer(report, json, _console(json, report))


@app.command()
def surface(
    scans: Annotated[
        list[Path],
        typer.Argument(help="Profilometer scans as CSV; several: the surfaces that touch.", show_default=False),
    ],
    unit: Annotated[
        str | None, typer.Option("--unit", help="Of the heights, where the file does not say.", show_default=False)
    ] = None,
    spacing: Annotated[
        float | None,
        typer.Option("--spacing-um", help="Of the points, where the file does not say.", show_default=False),
    ] = None,
    form: Annotated[
        int, typer.Option("--form", help="Degree of the polynomial taken off: 0 mean, 1 tilt, 2 curvature.")
    ] = 2,
    json: JsonPath = None,
) -> None:
    """Find roughness, asperity radius and density for section analysis.contact from profilometer scans."""
    from mesotap.commands.theory import surface as answer

    answer(scans, unit, spacing, form, json, _console(json))


@app.command("figures")
def paper_figures(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the figures.")] = Path("figures"),
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the simulated sessions.")] = 1,
    json: JsonPath = None,
) -> None:
    """Draw the paper's figures 3 and 5 to 9 again, and compare the numbers of its text with theory."""
    from mesotap.commands.theory import paper_figures as draw

    draw(output, seed, json, _console(json, output))


@app.command("import")
def import_(
    file: Annotated[Path, typer.Argument(help="CSV, MAT, UFF 58, WAV or TDMS file.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Argument(help="Session file to write; the same name with .h5 by default.", show_default=False),
    ] = None,
    rate: Annotated[
        float | None,
        typer.Option("--rate", help="Sampling rate in Hz, where the file does not say.", show_default=False),
    ] = None,
    channel: Annotated[
        list[str] | None,
        typer.Option("--channel", help="A, then B: name or number; the first two by default.", show_default=False),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Make a session file from a recording of another program."""
    from mesotap.commands.recordings import import_file

    import_file(file, output, rate, channel or (), json, _console(json))


@app.command()
def export(
    source: Annotated[Path, typer.Argument(help="Session file, session folder or recording.", show_default=False)],
    output: Annotated[Path, typer.Argument(help="File to write: .uff, .csv or .mat.", show_default=False)],
    rate: Annotated[
        float | None,
        typer.Option("--rate", help="Sampling rate in Hz, where the file does not say.", show_default=False),
    ] = None,
    text: Annotated[bool, typer.Option("--text", help="Data sets 58 as text, not binary.")] = False,
    modes: Annotated[
        bool, typer.Option("--modes", help="Also the modes, as data sets 55 of a universal file.")
    ] = False,
    json: JsonPath = None,
) -> None:
    """Write a recording, or the accepted impacts of a session, for another program."""
    from mesotap.commands.export import export as write

    write(source, output, rate, text, modes, json, _console(json))


@app.command()
def info(
    file: Annotated[Path, typer.Argument(help="Session file, session folder or recording.", show_default=False)],
    json: JsonPath = None,
) -> None:
    """Say what a file holds."""
    from mesotap.commands.recordings import info as describe

    describe(file, json, _console(json))


@app.command()
def hits(
    file: Annotated[Path, typer.Argument(help="Session file, or a finished session's folder.", show_default=False)],
    best: Annotated[
        int | None,
        typer.Option(min=1, max=1000, help="Use so many taps at each load: those whose ring-downs agree."),
    ] = None,
    keep: Annotated[list[int] | None, typer.Option(help="Use this tap, whatever spoke against it; repeatable.")] = None,
    drop: Annotated[list[int] | None, typer.Option(help="Do not use this tap; repeatable.")] = None,
    reason: Annotated[str, typer.Option(help="Why taps are kept or dropped; it is kept with each.")] = "",
    undo: Annotated[
        list[int] | None, typer.Option(help="Take back what was decided by hand on this tap; repeatable.")
    ] = None,
    reset: Annotated[bool, typer.Option("--reset", help="Undo all choices: the verdicts of the recording.")] = False,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="New session file with this choice.", show_default=False)
    ] = None,
    json: JsonPath = None,
) -> None:
    """Show which taps of a session are used and why others are not, or write it with another choice."""
    from mesotap.commands.hits import Choice
    from mesotap.commands.hits import hits as choose

    choose(file, Choice(best, keep or (), drop or (), reason, undo or (), reset), output, json, _console(json))


@app.command()
def diagnose(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Session file; several of one rig are diagnosed together; with --rig recordings of that rig.",
            show_default=False,
        ),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig", metavar="RIG.yaml", help="Description of a rig other than the tester.", show_default=False
        ),
    ] = None,
    json: JsonPath = None,
    without: Annotated[
        list[str] | None,
        typer.Option("--without", metavar="MECHANISM", help="Exclude a mechanism from the list.", show_default=False),
    ] = None,
    listed_only: Annotated[bool, typer.Option("--listed-only", help="Name listed mechanisms; learn no law.")] = False,
    published: Annotated[
        str | None,
        typer.Option("--published", metavar="flat|sphere", help="The paper's own gap instead.", show_default=False),
    ] = None,
    config: ConfigPath = None,
    contract: Annotated[
        int, typer.Option("--contract", min=1, max=2, help="Version of the JSON; 1 for the two-mass tester alone.")
    ] = 2,
    report: Report = None,
) -> None:
    """Say which physics the model, or the rig described, leaves out, where it acts, and how certain that is."""
    if published is not None:
        from mesotap.commands.theory import published_gap

        published_gap(published, json, report, _console(json, report))
        return
    if not files:
        raise typer.BadParameter("name a session file")
    from mesotap.commands.diagnose import Asked
    from mesotap.commands.diagnose import diagnose as find_out

    asked = Asked(rig, config, tuple(without or ()), json, report, 1 if contract == 1 else 2, not listed_only)
    find_out(files, asked, _console(json, report))


@app.command()
def adopt(
    diagnosis: Annotated[Path, typer.Argument(help="JSON of a diagnosis.", show_default=False)],
    config: ConfigPath = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Configuration to write.")] = Path("adopted.yaml"),
    json: JsonPath = None,
) -> None:
    """Give the simulated rig the mechanisms that a diagnosis found, so that it becomes a twin of the real one."""
    from mesotap.commands.diagnose import adopt as take_up

    take_up(diagnosis, config, output, json, _console(json))


@app.command()
def learn(
    diagnosis: Annotated[Path, typer.Argument(help="JSON of a diagnosis that learned a law.", show_default=False)],
    name: Annotated[str, typer.Option("--name", "-n", help="Of the mechanism.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of mechanisms.")] = Path("mechanisms"),
    rig: Annotated[
        Path | None,
        typer.Option("--rig", metavar="RIG.YAML", help="The rig it was learned in; the tester by default."),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Keep the law that a diagnosis learned as a mechanism of your own."""
    from mesotap.commands.learn import learn as keep

    keep(diagnosis, name, output, rig, json, _console(json))


@app.command()
def prove(
    seed: Annotated[int, typer.Option("--seed", min=0, help="Of the sessions.")] = 1,
    sessions: Annotated[
        int | None,
        typer.Option("--sessions", min=1, help="How many; 24, or all of --practice, by default.", show_default=False),
    ] = None,
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder of the proof.")] = Path("proof"),
    jobs: Annotated[int, typer.Option("--jobs", min=1, help="Diagnoses at a time.")] = 2,
    cluster: ClusterSite = None,
    only: Annotated[
        str | None,
        typer.Option(
            "--only",
            metavar="KIND",
            help="Only null, single, two, excluded (the true mechanism is excluded) or outside.",
            show_default=False,
        ),
    ] = None,
    practice: Annotated[
        Path | None,
        typer.Option("--practice", metavar="FOLDER", help="Sessions with a truth.json instead.", show_default=False),
    ] = None,
    rigs: Annotated[bool, typer.Option("--rigs", help="Recordings of described rigs instead of sessions.")] = False,
    outside: Annotated[
        bool, typer.Option("--outside", help="Effects outside the list alone; a null or a listed one now and then.")
    ] = False,
    size: Annotated[
        str | None,
        typer.Option("--size", metavar="LxT", help="Of --outside: loads x taps; 6x8 by default.", show_default=False),
    ] = None,
    sealed: Annotated[
        int | None,
        typer.Option(
            "--sealed",
            min=0,
            metavar="SEED",
            help="Of --outside: only the five effects that this seed holds back.",
            show_default=False,
        ),
    ] = None,
    unsealed: Annotated[
        int | None,
        typer.Option(
            "--unsealed",
            min=0,
            metavar="SEED",
            help="Of --outside: all but the five effects that this seed holds back.",
            show_default=False,
        ),
    ] = None,
    config: ConfigPath = None,
    json: JsonPath = None,
) -> None:
    """Validate the diagnosis blindly on sealed sessions that conceal an effect, and score its answers.

    An interrupted proof resumes where it stopped.
    """
    from mesotap.campaigns.cluster import engine_of
    from mesotap.commands.diagnose import own_folders
    from mesotap.commands.prove import prove as try_out
    from mesotap.commands.prove import prove_practice, subject_of

    subject = subject_of(rigs, outside, size, sealed, unsealed)
    with engine_of(cluster, jobs) as engine:
        if practice is not None:
            prove_practice(practice, sessions, output, engine, own_folders(config), _console(json, output), json)
        else:
            folders, shown = own_folders(config), _console(json, output)
            try_out(seed, sessions or 24, only, output, jobs, engine, folders, shown, subject, json)


app.add_typer(campaign_commands)
app.add_typer(catalogue_commands)
app.add_typer(plugin_commands)


@config_app.command("check")
def config_check(
    file: Annotated[Path | None, typer.Argument(help="config.yaml by default.", show_default=False)] = None,
    changes: Changes = None,
    json: JsonPath = None,
) -> None:
    """Check a configuration against the allowed values."""
    from mesotap.commands.config import older
    from mesotap.commands.outputs import write_json
    from mesotap.configuration.config import load_config, remarks
    from mesotap.operator.terminal import say

    found = [*([line] if (line := older(file)) else []), *remarks(load_config(file, changes or ()))]
    name = str(file or "config.yaml")
    if json is None or str(json) != "-":
        for line in (f"{name}: valid", *found):
            say(line)
    write_json(json, {"file": name, "valid": True, "remarks": found})


@config_app.command("show")
def config_show(config: ConfigPath = None, changes: Changes = None, json: JsonPath = None) -> None:
    """Print every key with the value in force."""
    from mesotap.commands.outputs import write_json
    from mesotap.configuration.config import effective_text, load_config
    from mesotap.operator.terminal import say

    loaded = load_config(config, changes or ())
    if json is None or str(json) != "-":
        say(effective_text(loaded).rstrip("\n"))
    write_json(json, loaded.model_dump(mode="json"))


@config_app.command("migrate")
def config_migrate(
    file: Annotated[Path | None, typer.Argument(help="config.yaml by default.", show_default=False)] = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Only show what would change.")] = False,
    json: JsonPath = None,
) -> None:
    """Rewrite a configuration of an older version, comments kept: shows the difference, keeps the old file."""
    from mesotap.commands.config import migrate

    migrate(file or Path("config.yaml"), dry_run, json, _console(json))


@config_app.command("init")
def config_init(
    file: Annotated[Path, typer.Argument(help="File to write.")] = Path("config.yaml"),
    json: JsonPath = None,
) -> None:
    """Write a commented configuration to start from; never overwrites one."""
    from mesotap.commands.outputs import write_json
    from mesotap.configuration.config import ConfigError, default_text
    from mesotap.operator.terminal import say

    try:
        with file.open("x", encoding="utf-8") as new:
            new.write(default_text())
    except FileExistsError:
        raise ConfigError(f"{file}: exists already; it is left as it is") from None
    if json is None or str(json) != "-":
        say(f"{file}: written; edit it, then 'mesotap config check {file}'")
    write_json(json, {"written": str(file)})


@rig_app.command("init")
def rig_init(
    files: Annotated[list[Path], typer.Argument(help="Recording; further ones of the same rig.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="File to write.")] = Path("rig.yaml"),
    rate: Annotated[
        float | None,
        typer.Option("--rate", help="Sampling rate in Hz, where the file does not say.", show_default=False),
    ] = None,
    inputs: Annotated[
        list[str] | None,
        typer.Option(
            "--input",
            metavar="CHANNEL",
            help="Channel that drives the rig, if not recognised.",
            show_default=False,
        ),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Look at a recording and write a commented first description of its rig; never overwrites one."""
    from mesotap.commands.rigs import begin_rig

    begin_rig(files, output, rate, inputs or (), json, _console(json))


@rig_app.command("check")
def rig_check(
    file: Annotated[Path, typer.Argument(help="Description of the rig.", show_default=False)],
    recordings: Annotated[
        list[Path] | None, typer.Argument(help="Recordings it is to be held against.", show_default=False)
    ] = None,
    json: JsonPath = None,
) -> None:
    """Say what these sensors cannot tell, and what to declare or leave free, before anything is fitted."""
    from mesotap.commands.rigs import check_rig

    check_rig(file, recordings or (), json, _console(json))


@certificate_app.command("write")
def certificate_write(
    source: Annotated[Path, typer.Argument(help="Session file or folder.", show_default=False)],
    output: Annotated[Path, typer.Option("--output", "-o", help="XML file to write; a new one.", show_default=False)],
    laboratory: Annotated[str, typer.Option("--laboratory", help="Who calibrated.", show_default=False)],
    city: Annotated[str, typer.Option("--city", help="Where.", show_default=False)],
    country: Annotated[str, typer.Option("--country", help="Two letters, as DE or US.", show_default=False)],
    config: ConfigPath = None,
    changes: Changes = None,
    json: JsonPath = None,
) -> None:
    """Write the gauge's calibration as a certificate in PTB's DCC format (supports ISO/IEC 17025; not signed)."""
    from mesotap.answers.certificate import Laboratory
    from mesotap.commands.certificate import write_certificate

    write_certificate(
        source, output, Laboratory(laboratory, city, country), config, changes or (), json, _console(json)
    )


@certificate_app.command("check")
def certificate_check(
    file: Annotated[Path, typer.Argument(help="Certificate, XML.", show_default=False)],
    schema: Annotated[
        Path | None,
        typer.Option("--schema", help="dcc.xsd of PTB, with what it imports beside it.", show_default=False),
    ] = None,
    json: JsonPath = None,
) -> None:
    """Read a digital calibration certificate and say what is wrong with it."""
    from mesotap.commands.certificate import check_certificate

    check_certificate(file, schema, json, _console(json))
