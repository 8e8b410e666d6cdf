"""The files and functions that a call enters are counted in order."""

import pytest
import walks


@pytest.mark.full
def test_a_walk_lists_what_it_enters_in_order():
    entered = walks.walk(walks.trees.ROOT, "step").entered
    functions = [function.rpartition(".")[2] for _, function in entered]
    assert functions[0] == "step"
    assert functions.index("before_step") < functions.index("after_step")
    assert all((walks.trees.ROOT / file).is_file() for file, _ in entered)


def test_the_tracer_counts_calls_between_files_of_the_tree_alone(tmp_path):
    sources = {
        "one.py": "import two\n\n\ndef start():\n    return two.end(sorted([1]))\n",
        "two.py": "def end(x):\n    return x\n",
    }
    modules = {}
    for name, text in sources.items():
        exec(compile(text.replace("import two", ""), str(tmp_path / name), "exec"), modules.setdefault(name, {}))
    modules["one.py"]["two"] = type("two", (), {"end": staticmethod(modules["two.py"]["end"])})
    tracer = walks.Tracer(tmp_path)
    with tracer.tracing():
        modules["one.py"]["start"]()
    assert tracer.walk == walks.Walk(entered=(("one.py", "start"), ("two.py", "end")), crossings=1)


def test_an_example_is_counted_without_comments_and_docstrings(tmp_path):
    text = '"""Docstring."""\n\n# Comment.\nimport kitchen_suite\nfrom kitchen_suite import suite\n\n\n'
    text += 'def f():\n    """Text."""\n    return suite\n'
    path = tmp_path / "example.py"
    path.write_text(text, encoding="utf-8")
    assert list(walks.example(path).values()) == [1, 4]
