"""Whether tests notice faults: small ones are put into a module, one at a time, and its tests are run.

`python -m benchmarks.mutants [plan|budget|chain|problems …]` prints every fault that no test notices, with its line.
Linux and macOS alone: each fault is tried in a fork of a process that has imported what takes long.
"""

from __future__ import annotations

import ast
import copy
import importlib
import importlib.abc
import importlib.machinery
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

import pytest

ROOT = Path(__file__).parents[1]
LIMIT_S = 120
"""A fault may make a loop endless; that counts as noticed."""
AT_A_TIME = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
TARGETS: dict[str, tuple[list[str], list[str]]] = {
    "plan": (
        [f"entoptic.pipeline.plan.{name}" for name in ("steps", "chain", "reasons", "make")],
        ["tests/pipeline/plan/test_make_plan.py"],
    ),
    "budget": ([f"entoptic.pipeline.budget.{name}" for name in ("choose", "steady")], ["tests/pipeline/budget"]),
    "chain": (
        [f"entoptic.tracker_bridge.{name}" for name in ("chain", "dropout")],
        [
            f"tests/tracker_bridge/test_{name}.py"
            for name in ("chain", "dropout", "lid_dips", "extrapolation", "fixed_lag", "labelled_blinks")
        ],
    ),
    "problems": (["entoptic.services.console.problems"], ["tests/services/console/test_console_problems.py"]),
}
"""By group: modules, and the tests that are to notice faults in them."""
COMPARED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
COMPUTED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip
CALLED = {"min": "max", "max": "min", "any": "all", "all": "any"}


def faults_of(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that may stand in for this one."""
    if isinstance(node, ast.Compare):
        for at, operator in enumerate(node.ops):
            changed = copy.deepcopy(node)
            changed.ops[at] = COMPARED[type(operator)]()
            yield changed
    elif isinstance(node, ast.BinOp) and type(node.op) in COMPUTED:
        yield ast.BinOp(node.left, COMPUTED[type(node.op)](), node.right)
    elif isinstance(node, ast.BoolOp):
        yield ast.BoolOp(ast.Or() if isinstance(node.op, ast.And) else ast.And(), node.values)
        for at in range(len(node.values)):
            yield ast.BoolOp(node.op, [value for k, value in enumerate(node.values) if k != at] * 2)
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        yield node.operand
    elif isinstance(node, ast.IfExp):
        yield node.body
        yield node.orelse
    elif isinstance(node, ast.If):
        for value in (True, False):
            yield ast.If(ast.Constant(value), node.body, node.orelse)
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        yield ast.Constant(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        yield ast.Constant(node.value * 2 if isinstance(node.value, float) and node.value else node.value + 1)
        if node.value:
            yield ast.Constant(type(node.value)(0))
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id in CALLED:
        yield ast.Call(ast.Name(CALLED[node.func.id], ast.Load()), node.args, node.keywords)
    elif isinstance(node, ast.Continue | ast.Break):
        yield ast.Pass()


class _Replace(ast.NodeTransformer):
    def __init__(self, old: ast.AST, new: ast.AST) -> None:
        self._old, self._new = old, new

    def visit(self, node: ast.AST) -> ast.AST:
        return ast.copy_location(self._new, node) if node is self._old else self.generic_visit(node)


def _is_typing(tree: ast.Module) -> set[ast.AST]:
    """Nodes that no run evaluates or that only decorate: annotations and decorators."""
    roots: list[ast.AST] = []
    for node in ast.walk(tree):
        roots += [part for part in (getattr(node, "annotation", None), getattr(node, "returns", None)) if part]
        roots += getattr(node, "decorator_list", [])
    return {inner for root in roots for inner in ast.walk(root)}


def mutants(source: str, path: str) -> Iterator[tuple[int, str, CodeType]]:
    """(line, what was changed, compiled module) of each fault."""
    tree = ast.parse(source)
    left_out = _is_typing(tree)
    for node in [node for node in ast.walk(tree) if node not in left_out]:
        for new in faults_of(node):
            clean = ast.parse(source)
            # The same node of a tree that no fault has touched: walks are in the same order.
            twin = dict(zip(ast.walk(tree), ast.walk(clean), strict=True))[node]
            _Replace(twin, copy.deepcopy(new)).visit(clean)
            changed = compile(ast.fix_missing_locations(clean), path, "exec")
            before = ast.unparse(node).split("\n")[0]
            after = ast.unparse(ast.fix_missing_locations(ast.copy_location(copy.deepcopy(new), node))).split("\n")[0]
            yield getattr(node, "lineno", 0), f"{before}  →  {after}", changed


def _functions(holder: Mapping[str, object]) -> Iterator[FunctionType]:
    """Those that a module's or a class's names stand for, whatever wraps them."""
    for value in list(holder.values()):
        if isinstance(value, type) and value.__module__ == holder.get("__name__", holder.get("__module__")):
            yield from _functions(vars(value))
        parts = [getattr(value, name, None) for name in ("__func__", "fget", "func", "__wrapped__")]
        yield from (part for part in (value, *parts) if isinstance(part, FunctionType))


def _codes(code: CodeType) -> Iterator[CodeType]:
    for part in code.co_consts:
        if isinstance(part, CodeType):
            yield part
            yield from _codes(part)


def _put_in(module: ModuleType, before: CodeType, after: CodeType) -> bool:
    """Changes the functions of a module that is imported already; False where the fault lies outside all of them."""
    old = {(code.co_qualname, code.co_firstlineno): code for code in _codes(before)}
    new = {(code.co_qualname, code.co_firstlineno): code for code in _codes(after)}
    differ = {place: code for place, code in new.items() if old.get(place) != code}
    found = False
    for function in _functions(vars(module)):
        code = function.__code__
        if (code.co_qualname, code.co_firstlineno) in differ and code.co_filename == module.__file__:
            function.__code__ = differ[code.co_qualname, code.co_firstlineno]
            found = True
    return found


def _noticed(module: ModuleType, before: CodeType, after: CodeType, tests: list[str]) -> int:
    """The exit status of pytest on a mutant; in a fork."""
    signal.alarm(LIMIT_S)
    with open(os.devnull, "w") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)
    if after is not before and not _put_in(module, before, after):
        # A constant, or a class's body: what has copied it is imported again.
        for name in [name for name in sys.modules if name.partition(".")[0] == "entoptic"]:
            del sys.modules[name]
        sys.meta_path.insert(0, _Mutant(module.__name__, after))
    return int(pytest.main(["-x", "-q", "-p", "no:cacheprovider", "-W", "ignore", *tests]))


class _Mutant(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Gives a module's mutant in place of the module."""

    def __init__(self, name: str, code: CodeType) -> None:
        self._name, self._code = name, code

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        if fullname != self._name:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin="mutant")

    def exec_module(self, module: ModuleType) -> None:
        exec(self._code, module.__dict__)


def _forked(work: Callable[[], int]) -> int:
    """The process id."""
    sys.stdout.flush()
    if pid := os.fork():
        return pid
    status = 70
    try:
        status = work()
    finally:
        os._exit(status)


def survivors(name: str, tests: list[str]) -> Iterator[tuple[int, str, bool]]:
    """Of each fault of a module: line, what, whether it was noticed."""
    module = importlib.import_module(name)
    path = str(module.__file__)
    source = Path(path).read_text(encoding="utf-8")
    before = compile(source, path, "exec")
    running: dict[int, tuple[int, str]] = {}

    def ended() -> tuple[int, str, bool]:
        pid, status = os.wait()
        return *running.pop(pid), status != 0

    for line, what, code in [(0, "nothing", before), *mutants(source, path)]:
        running[_forked(lambda code=code: _noticed(module, before, code, tests))] = line, what  # type: ignore[misc]
        if len(running) >= AT_A_TIME:
            yield ended()
    while running:
        yield ended()


def main() -> None:
    """Prints survivors by module, and how many faults there were."""
    os.chdir(ROOT)
    groups = sys.argv[1:] or list(TARGETS)
    for name, tests in [(name, TARGETS[group][1]) for group in groups for name in TARGETS[group][0]]:
        begun_s, count, left = time.monotonic(), 0, 0
        for line, what, noticed in survivors(name, tests):
            if what == "nothing":
                if noticed:
                    sys.exit(f"{name}: its tests fail as it is")
                continue
            count += 1
            if not noticed:
                left += 1
                print(f"{name}:{line}  {what}", flush=True)
        print(f"{name}: {count} faults, {left} not noticed, {time.monotonic() - begun_s:.0f} s", flush=True)


if __name__ == "__main__":
    main()
