"""Everything exported has a docstring in the style of numpydoc and a stub that agrees with it."""

import ast
import doctest
import inspect
from pathlib import Path

import pytest

import mpct
import mpct._mpct
import mpct._run
import mpct._sweep
import mpct.plots

FOLDER = Path(mpct.__file__).parent
STUB = ast.parse((FOLDER / "_mpct.pyi").read_text(encoding="utf-8"))


def public(namespace):
    return sorted(n for n in vars(namespace) if not n.startswith("_"))


def names_of(body):
    return {item.name for item in body if isinstance(item, (ast.ClassDef, ast.FunctionDef))}


COMPILED = [name for name in mpct.__all__ if isinstance(getattr(mpct._mpct, name, None), type)]
PYTHON = [n for n in mpct.__all__ if n not in COMPILED and n != "__version__"] + [f"plots.{n}" for n in mpct.plots.__all__]


def find(name):
    thing = mpct
    for part in name.split("."):
        thing = getattr(thing, part)
    return thing


def sections(function, parameters):
    doc = inspect.getdoc(function) or ""
    assert doc.strip(), f"{function} has no docstring"
    if parameters:
        assert "Parameters\n----------" in doc, f"{function} says nothing about its parameters"
        for parameter in parameters:
            assert parameter in doc, f"{function} says nothing about {parameter}"


def parameters_of(function):
    return [p for p in inspect.signature(function).parameters if p not in ("self", "cls")]


def test_every_public_name_is_exported():
    assert set(COMPILED) == {n for n in public(mpct._mpct) if isinstance(getattr(mpct._mpct, n), type)}
    assert sorted(mpct.__all__) == mpct.__all__
    assert (FOLDER / "py.typed").exists()


def test_stub_has_the_names_of_the_module():
    assert names_of(STUB.body) - {"_StateSpace"} == set(public(mpct._mpct))


@pytest.mark.parametrize("name", COMPILED)
def test_compiled_class(name):
    thing = getattr(mpct, name)
    stub = next(item for item in STUB.body if isinstance(item, ast.ClassDef) and item.name == name)
    assert names_of(stub.body) - {"__new__"} == set(public(thing))
    assert thing.__module__ == "mpct"
    constructed = any(f.name == "__new__" for f in stub.body if isinstance(f, ast.FunctionDef))
    sections(thing, parameters_of(thing) if constructed else [])
    for member in public(thing):
        value = getattr(thing, member)
        if callable(value):
            parameters = parameters_of(value)
            sections(value, parameters)
            stubbed = next(f for f in stub.body if isinstance(f, ast.FunctionDef) and f.name == member)
            arguments = stubbed.args.posonlyargs + stubbed.args.args + stubbed.args.kwonlyargs
            assert [a.arg for a in arguments if a.arg != "self"] == parameters
            assert stubbed.returns is not None
        else:
            sections(value, [])


@pytest.mark.parametrize("name", PYTHON)
def test_python_export(name):
    thing = find(name)
    if isinstance(thing, type):
        doc = inspect.getdoc(thing)
        assert "Attributes\n----------" in doc
        for member in getattr(thing, "__annotations__", {}):
            assert member in doc, f"{name} says nothing about {member}"
        functions = [
            getattr(thing, n) for n in public(thing) if inspect.isfunction(getattr(thing, n)) and n in vars(thing)
        ]
    else:
        functions = [thing]
    for function in functions:
        sections(function, parameters_of(function))
        if function.__module__.startswith("mpct"):
            annotated = set(function.__annotations__)
            assert annotated >= set(parameters_of(function)) | {"return"}, f"{function} is not annotated"


def test_examples():
    count = 0
    finder = doctest.DocTestFinder()
    runner = doctest.DocTestRunner()
    things = {"mpct": mpct, **{name: getattr(mpct, name) for name in mpct.__all__ if name != "__version__"}}
    for name, thing in things.items():
        for test in finder.find(thing, name, module=False, globs={}):
            runner.run(test)
            count += len(test.examples)
    assert count >= 10
    assert runner.failures == 0
