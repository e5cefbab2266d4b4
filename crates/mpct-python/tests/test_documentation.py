"""Everything exported has a docstring in the style of numpydoc and a stub that agrees with it."""

import ast
import doctest
import importlib
import inspect
import re
from pathlib import Path

import pytest

import mpct
import mpct._mpct
import mpct.plots

FOLDER = Path(mpct.__file__).parent
STUB = ast.parse((FOLDER / "_mpct.pyi").read_text(encoding="utf-8"))
COMPILED = [name for name in mpct.__all__ if isinstance(getattr(mpct._mpct, name, None), type)]
PYTHON = [n for n in mpct.__all__ if n not in COMPILED and n != "__version__"] + [f"plots.{n}" for n in mpct.plots.__all__]


def members(namespace):
    return {n for n in vars(namespace) if not n.startswith("__")}


def names_of(body):
    return {item.name for item in body if isinstance(item, (ast.ClassDef, ast.FunctionDef))}


def find(name):
    thing = mpct
    for part in name.split("."):
        thing = getattr(thing, part)
    return thing


def parameters_of(function):
    return [p for p in inspect.signature(function).parameters.values() if p.name not in ("self", "cls", "options", "style")]


def documented(text, section):
    """Names under the heading of a numpydoc section."""
    match = re.search(rf"^{section}\n-+\n(.*?)(?=^\w[\w ]*\n-+$|\Z)", text, re.DOTALL | re.MULTILINE)
    found = set()
    for line in (match.group(1) if match else "").splitlines():
        if line and not line.startswith(" "):
            found |= {name.strip(" *") for name in line.split(" : ")[0].split(",")}
    return found


def check_docstring(thing, parameters, returns):
    doc = inspect.getdoc(thing) or ""
    assert doc.strip(), f"{thing} has no docstring"
    summary = doc.split("\n\n")[0].strip()
    assert summary.endswith((".", ":")) and "---" not in summary, f"{thing} has no summary"
    missing = {p.name for p in parameters} - documented(doc, "Parameters")
    assert not missing, f"{thing} says nothing about {missing}"
    if returns:
        assert "Returns\n-------" in doc, f"{thing} does not say what it returns"


def arguments_of(function):
    """(name, default, keyword only) of a function in the stub."""
    a = function.args
    positional = a.posonlyargs + a.args
    defaults = [None] * (len(positional) - len(a.defaults)) + a.defaults
    listed = [(p.arg, d, False) for p, d in zip(positional, defaults)]
    listed += [(p.arg, d, True) for p, d in zip(a.kwonlyargs, a.kw_defaults)]
    return [item for item in listed if item[0] not in ("self", "cls")]


def check_signature(thing, stubs):
    """Names, order, kinds and defaults; of several overloads, the names of each."""
    real = parameters_of(thing)
    for stub in stubs:
        stubbed = arguments_of(stub)
        assert stub.returns is not None
        assert [s[0] for s in stubbed] == [p.name for p in real], thing
        if len(stubs) > 1:
            continue
        for (name, default, keyword_only), p in zip(stubbed, real):
            assert keyword_only == (p.kind is p.KEYWORD_ONLY), (thing, name)
            assert (default is None) == (p.default is p.empty), (thing, name)
            # PyO3 shows the default of a list as an ellipsis.
            if default is not None and not (isinstance(default, ast.Constant) and default.value is Ellipsis):
                assert ast.literal_eval(default) == p.default, (thing, name)


def test_every_public_name_is_exported():
    assert set(COMPILED) == {n for n in members(mpct._mpct) if isinstance(getattr(mpct._mpct, n), type)}
    assert sorted(mpct.__all__) == mpct.__all__
    assert (FOLDER / "py.typed").exists()
    for module in ("_errors", "_figures", "_files", "_results", "_run", "_sweep", "_campaign"):
        module = importlib.import_module(f"mpct.{module}")
        public = {n for n, v in vars(module).items() if not n.startswith("_") and getattr(v, "__module__", "") == "mpct"}
        assert public <= set(mpct.__all__), module


def test_stub_has_the_names_of_the_module():
    assert names_of(STUB.body) - {"_StateSpace"} == members(mpct._mpct)
    for item in STUB.body:
        if isinstance(item, ast.FunctionDef):
            check_signature(getattr(mpct._mpct, item.name), [item])


@pytest.mark.parametrize("name", COMPILED)
def test_compiled_class(name):
    thing = getattr(mpct, name)
    stub = next(item for item in STUB.body if isinstance(item, ast.ClassDef) and item.name == name)
    assert names_of(stub.body) - {"__new__"} == members(thing)
    assert thing.__module__ == "mpct"
    constructors = [f for f in stub.body if isinstance(f, ast.FunctionDef) and f.name == "__new__"]
    if constructors:
        check_signature(thing, constructors)
    check_docstring(thing, parameters_of(thing) if constructors else [], False)
    for member in members(thing):
        value = getattr(thing, member)
        stubbed = [f for f in stub.body if isinstance(f, ast.FunctionDef) and f.name == member]
        if callable(value):
            check_signature(value, stubbed)
            returns = not (isinstance(stubbed[0].returns, ast.Constant) and stubbed[0].returns.value is None)
            check_docstring(value, parameters_of(value), returns)
        else:
            check_docstring(value, [], False)
            assert [d.id for d in stubbed[0].decorator_list] == ["property"]


@pytest.mark.parametrize("name", PYTHON)
def test_python_export(name):
    thing = find(name)
    if isinstance(thing, type):
        doc = inspect.getdoc(thing)
        missing = set(vars(thing).get("__annotations__", {})) - documented(doc, "Attributes")
        assert not missing, f"{name} says nothing about {missing}"
        functions = [getattr(thing, n) for n in members(thing) if not n.startswith("_")]
        functions = [f for f in functions if inspect.isfunction(f) or inspect.ismethod(f)]
    else:
        functions = [thing]
    for function in functions:
        annotated = set(function.__annotations__)
        names = {p.name for p in parameters_of(function)}
        assert annotated >= names | {"return"}, f"{function} is not annotated"
        check_docstring(function, parameters_of(function), function.__annotations__["return"] != "None")


def test_examples():
    finder, runner = doctest.DocTestFinder(), doctest.DocTestRunner()
    things = {"mpct": mpct, **{name: getattr(mpct, name) for name in mpct.__all__ if name != "__version__"}}
    count = 0
    for name, thing in things.items():
        for test in finder.find(thing, name, module=False, globs={}):
            runner.run(test)
            count += len(test.examples)
    assert count >= 40
    assert runner.failures == 0
