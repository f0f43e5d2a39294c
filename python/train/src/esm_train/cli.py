"""The command line: data on standard output, progress on standard error; errors are one message and exit code 2."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from esm_train.errors import TrainError

if TYPE_CHECKING:
    from esm_train.config import Config


def main(arguments: list[str] | None = None) -> None:
    """Entry point of `esm-train`."""
    options = _parser().parse_args(arguments)
    try:
        code = options.call(options)
    except TrainError as error:
        print(f"error: {error}", file=sys.stderr)
        code = 2
    except KeyboardInterrupt:
        code = 130
    sys.exit(code)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="esm-train", description="Trains the segment descriptor of esm.")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    def command(name: str, call: object, text: str) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=text, description=text)
        sub.set_defaults(call=call)
        return sub

    def configured(sub: argparse.ArgumentParser) -> None:
        sub.add_argument("--config", type=Path, required=True, help="TOML file; see `esm-train config`")
        sub.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE", help="overrides the file")
        sub.add_argument("--data", action="append", default=[], type=Path, help="training set, instead of data.train")

    command("config", _config, "Prints all settings with their defaults.")
    run = command(
        "run", _run, "Trains the network and the quality head, exports, and evaluates on the validation sets."
    )
    configured(run)
    run.add_argument("--resume", action="store_true", help="continue where the last checkpoint stands")
    train = command("train", _train, "Trains the network.")
    configured(train)
    train.add_argument("--resume", action="store_true", help="continue where the last checkpoint stands")
    head = command("head", _head, "Trains the last layers further, with batches in which thousands of objects compete.")
    configured(head)
    head.add_argument("--checkpoint", type=Path, help="instead of latest.pt of the run")
    peer = command(
        "segmap", _segmap, "Trains SegMap's encoder, the peer, and exports its weights (configs/segmap.toml)."
    )
    peer.add_argument("--config", type=Path, required=True, help="TOML file")
    peer.add_argument("--set", action="append", default=[], metavar="SECTION.KEY=VALUE", help="overrides the file")
    peer.add_argument("--resume", action="store_true", help="continue where the last checkpoint stands")
    peer.add_argument(
        "--export", action="store_true", help="write the weights of the last checkpoint, without training"
    )
    grown = command("forest", _forest, "Grows the random forest of SegMatch or NSM (uv run --group peers).")
    grown.add_argument("kind", choices=("segmatch", "nsm"))
    grown.add_argument("--data", action="append", required=True, help="training set, or directory of sets")
    grown.add_argument("--tune", action="append", required=True, help="sets on which the limit is chosen")
    grown.add_argument("--program", type=Path, default=Path("../../target/release/examples/describe"))
    grown.add_argument("--segments", type=int, default=30_000)
    grown.add_argument("--pairs", type=int, default=100_000)
    grown.add_argument("--seed", type=int, default=0)
    grown.add_argument("--golden", type=Path, help="also write pairs with scikit-learn's answers")
    grown.add_argument("-o", "--output", type=Path, required=True)
    export = command("export", _export, "Fits the quality head and writes the weights file (WEIGHTS.md).")
    configured(export)
    export.add_argument("--checkpoint", type=Path, help="instead of latest.pt of the run")
    export.add_argument("-o", "--output", type=Path, help="instead of export.weights")
    initial = command("init", _init, "Writes a weights file of random, untrained weights, for tests of other programs.")
    initial.add_argument("--variant", default="esm-swift")
    initial.add_argument("--size-mode", help="none, beside, fc or both")
    initial.add_argument("--seed", type=int, default=0)
    initial.add_argument("-o", "--output", type=Path, required=True)
    judge = command("evaluate", _evaluate, "ROC, recall, reliability and embedding of weights beside the baselines.")
    judge.add_argument("--weights", action="append", type=Path, required=True, help="weights file; several compare")
    judge.add_argument("--map", action="append", required=True, help="segments of the map; DIR@0: visit 0 of DIR")
    judge.add_argument("--live", action="append", required=True, help="segments of the query; DIR@1: visit 1 of DIR")
    judge.add_argument("--truth", choices=("auto", "object", "position"), default="auto")
    judge.add_argument("--radius", type=float, default=0.7, help="metres between counterparts, by position")
    judge.add_argument(
        "--engine",
        choices=("pytorch", "core"),
        default="pytorch",
        help="core: as robots run it, and faster on a CPU (uv run --group core)",
    )
    judge.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    judge.add_argument("--seed", type=int, default=0)
    judge.add_argument("--json", action="store_true")
    judge.add_argument("-o", "--output", type=Path, required=True, help="directory of report.json and the pictures")
    gold = command("golden", _golden, "Writes golden activations of a weights file (WEIGHTS.md).")
    gold.add_argument("--weights", type=Path, required=True)
    gold.add_argument("--data", action="append", default=[], help="segments of these sets; inputs and answers only")
    gold.add_argument("--segments", type=int, default=24)
    gold.add_argument("--seed", type=int, default=0)
    gold.add_argument("-o", "--output", type=Path, required=True)
    check = command("check", _check, "Reads sets of labelled segments once and reports the first violation of DATA.md.")
    check.add_argument("sets", nargs="+", type=Path)
    make = command("synthetic", _synthetic, "Writes a set of synthetic objects seen in part.")
    make.add_argument("--objects", type=int, default=500)
    make.add_argument("--observations", type=int, default=2)
    make.add_argument("--seed", type=int, default=0)
    make.add_argument("--visit", type=int, default=0)
    make.add_argument("-o", "--output", type=Path, required=True)
    rate = command("bench", _bench, "Segments a second through inputs, forward pass and training step.")
    rate.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    rate.add_argument("--threads", type=int, default=0)
    rate.add_argument("--classes", type=int, default=32, help="objects a batch, two segments each")
    rate.add_argument("--repeat", type=int, default=3)
    beside = command("race", _race, "Times the forward pass beside PyTorch's and ONNX Runtime's (uv run --group race).")
    beside.add_argument("--weights", type=Path, required=True)
    beside.add_argument("--program", type=Path, default=Path("../../target/release/examples/forward"))
    beside.add_argument("--threads", type=int, default=1)
    beside.add_argument("--segments", type=int, default=46)
    beside.add_argument("--rounds", type=int, default=7)
    beside.add_argument("--json", action="store_true")
    return parser


def _race(options: argparse.Namespace) -> int:
    from esm_train.race import race, table

    report = race(options.weights, options.program, options.threads, options.segments, options.rounds)
    print(json.dumps(report) if options.json else table(report))
    return 0


def _config(_options: argparse.Namespace) -> int:
    from esm_train.config import defaults_as_toml

    print(defaults_as_toml())
    return 0


def _load(options: argparse.Namespace) -> Config:
    import dataclasses

    from esm_train.config import load_config

    config = load_config(options.config, options.set)
    if options.data:
        sets = tuple(str(p.resolve()) for p in options.data)
        config = dataclasses.replace(config, data=dataclasses.replace(config.data, train=sets))
    return config


def _train(options: argparse.Namespace) -> int:
    from esm_train.run import train

    return 0 if train(_load(options), options.resume) else 1


def _segmap(options: argparse.Namespace) -> int:
    from esm_train.segmap.config import load_segmap_config
    from esm_train.segmap.trainer import SegMapTrainer, export

    config = load_segmap_config(options.config, options.set)
    if not options.export and not SegMapTrainer(config, resume=options.resume).run():
        return 1
    print(json.dumps(export(config), indent=1))
    return 0


def _forest(options: argparse.Namespace) -> int:
    from esm_train.forest.grow import grow, write_forest, write_forest_golden

    train, tune = tuple(options.data), tuple(options.tune)
    forest, facts, tuned = grow(
        options.program,
        options.kind,
        train,
        tune,
        rows=options.segments,
        pairs=options.pairs,
        seed=options.seed,
    )
    write_forest(forest, options.kind, tuned[2].shape[1], facts, options.output)
    if options.golden:
        write_forest_golden(forest, tuned, 100, options.golden)
    print(json.dumps(facts, indent=1))
    return 0


def _head(options: argparse.Namespace) -> int:
    from esm_train.run import head

    head(_load(options), options.checkpoint)
    return 0


def _export(options: argparse.Namespace) -> int:
    from esm_train.run import export

    report = export(_load(options), options.checkpoint, options.output)
    print(json.dumps(report, indent=1))
    return 0


def _run(options: argparse.Namespace) -> int:
    from esm_train.run import run

    return 0 if run(_load(options), options.resume) else 1


def _init(options: argparse.Namespace) -> int:
    import torch

    from esm_train.plan import plan_for
    from esm_train.run import random_network
    from esm_train.weights import to_weights, write_weights

    try:
        plan = plan_for(options.variant, size_mode=options.size_mode)
    except ValueError as error:
        raise TrainError(str(error)) from None
    torch.manual_seed(options.seed)
    model, head = random_network(plan)
    write_weights(to_weights(model, head, {"training": "none: random weights"}), options.output)
    return 0


def _evaluate(options: argparse.Namespace) -> int:
    from esm_train.describers import Core, Describer, PyTorch
    from esm_train.evaluate import evaluate, table
    from esm_train.segmap.describer import SegMap
    from esm_train.segmap.weights import ARCHITECTURE, load_segmap
    from esm_train.trainer import device_of
    from esm_train.validation import open_sides
    from esm_train.weights import architecture_of, load_network

    sides = open_sides(tuple(options.map), tuple(options.live), "evaluate", options.truth, options.radius)
    describers: list[Describer] = []
    for file in options.weights:
        if architecture_of(file) == ARCHITECTURE and options.engine != "core":
            describers.append(SegMap(file.stem, load_segmap(file)[0]))
            continue
        model, head, metadata = load_network(file)
        taken = any(d.name == metadata["variant"] for d in describers)
        name = file.stem if taken else metadata["variant"]
        core = options.engine == "core"
        describers.append(Core(name, file) if core else PyTorch(name, model, head, device_of(options.device)))
    report = evaluate(describers, sides, options.output, options.seed)
    print(json.dumps(report) if options.json else table(report))
    return 0


def _golden(options: argparse.Namespace) -> int:
    from esm_train.golden import write_answers, write_golden
    from esm_train.segmap.weights import ARCHITECTURE, write_segmap_golden
    from esm_train.validation import open_corpus
    from esm_train.weights import architecture_of, load_network

    count = options.segments
    if architecture_of(options.weights) == ARCHITECTURE:
        if not options.data:
            raise TrainError(
                f"{options.weights}: golden segments of these weights come from sets", "name some by --data"
            )
        size = write_segmap_golden(options.weights, tuple(options.data), count, options.output)
        print(f"{options.output}: {count} segments, {size} bytes", file=sys.stderr)
        return 0
    model, head, _ = load_network(options.weights)
    if options.data:
        corpus = open_corpus(tuple(options.data), "golden")
        size = write_answers(model, head, options.weights, corpus, options.output, count)
    else:
        size = write_golden(model, head, options.weights, options.output, count=count, seed=options.seed)
    print(f"{options.output}: {options.segments} segments, {size} bytes", file=sys.stderr)
    return 0


def _check(options: argparse.Namespace) -> int:
    from esm_train.corpus import Corpus, identities
    from esm_train.segments import SegmentSet

    for path in options.sets:
        data = SegmentSet(path)
        data.check()
        objects = len(identities(Corpus([data])))
        m = data.meta
        print(f"{path}: {m.segments} segments, {m.points} points, {objects} objects in two observations or more")
    return 0


def _synthetic(options: argparse.Namespace) -> int:
    from esm_train.synthetic import write_synthetic

    write_synthetic(
        options.output,
        objects=options.objects,
        observations=options.observations,
        seed=options.seed,
        visit=options.visit,
    )
    return 0


def _bench(options: argparse.Namespace) -> int:
    import torch

    from esm_train.bench import bench
    from esm_train.trainer import device_of

    if options.threads:
        torch.set_num_threads(options.threads)
    print(bench(device_of(options.device), options.classes, options.repeat))
    return 0
