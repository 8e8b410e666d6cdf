"""Each library that opens what others have written is used in one module, which shuts what is not used of it.

As tests/test_layers.py, on syntax trees: calls that read files, unpickle, connect, or import by name.
"""

import ast

import pytest
from helpers.modules import imported_names, modules, stated_names

# Modules that may use a library.
LIBRARIES = {
    "h5py": {"datasets.hdf5"},
    "websockets": {"policies.remote"},
    "msgpack": {"policies.remote"},
    "zipfile": {"files", "evaluation.receipt"},
    "numpy.lib": {"files"},
    # Its names of hosts and bound ports; no data are read by it.
    "socket": {"viewer.servers"},
}
# Libraries that no module may use: what they read can name code, or comes from elsewhere.
NONE = (
    *("pickle", "dill", "joblib", "cloudpickle", "marshal", "shelve", "yaml", "zarr", "numcodecs", "tarfile"),
    *("http", "urllib.request", "requests", "ftplib", "xmlrpc", "pandas", "pyarrow"),
)
LIBRARIES |= {library: set() for library in NONE}

# Modules that may call a function, by the end of its name.
CALLS = {
    "torch.load": {"training.run"},
    "np.load": set(),
    "np.fromfile": set(),
    "np.memmap": set(),
    "json.load": set(),
    "json.loads": {"files"},
    "msgspec.json.decode": set(),
    "msgspec.msgpack.decode": {"viewer.web_page"},
    "eval": set(),
    "exec": set(),
    "compile": set(),
    "__import__": set(),
    "pkgutil.resolve_name": {"datasets.formats", "imports", "lazy", "domains.domain", "environment.private_names"},
    "mujoco.MjModel.from_xml_path": set(),
    "mujoco.MjModel.from_binary_path": set(),
}

# Modules that import by a name that is no literal: their own tables, and MuJoCo's GL libraries.
IMPORTERS = {"imports", "lazy", "commands", "rendering.without_gl", "rendering.contexts"}

# What writes and reads in the same expression, to make Python's values JSON's.
ROUND_TRIPS = ("json.dumps", "msgspec.json.encode")


def name_of(node):
    """The dotted name of a function that is called; empty for another expression."""
    if isinstance(node, ast.Attribute):
        inner = name_of(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return node.id if isinstance(node, ast.Name) else ""


def calls(tree):
    """Calls in a module: names of functions, and arguments."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and (name := name_of(node.func)):
            yield name, node.args


def is_round_trip(arguments):
    return bool(arguments) and isinstance(arguments[0], ast.Call) and name_of(arguments[0].func) in ROUND_TRIPS


@pytest.mark.full
@pytest.mark.parametrize("library", LIBRARIES)
def test_a_library_that_opens_files_has_one_module(library):
    homes = {
        module
        for module, tree in modules().items()
        if any(name == library or name.startswith(f"{library}.") for name in imported_names(tree))
    }
    assert homes <= LIBRARIES[library]


@pytest.mark.full
@pytest.mark.parametrize("function", CALLS)
def test_what_reads_the_data_of_others_is_called_in_one_module(function):
    homes = {
        module
        for module, tree in modules().items()
        for name, arguments in calls(tree)
        if (name == function or name.endswith(f".{function}"))
        and not is_round_trip(arguments)
        # Those of modules and objects, such as `re.compile`.
        and not ("." not in function and name != function)
    }
    # The worker of a vector of LeRobot's reads what its own process has written.
    assert homes - {"lerobot.environments"} <= CALLS[function]


def test_names_are_imported_in_one_module():
    homes = {
        module
        for module, tree in modules().items()
        for name, arguments in calls(tree)
        if name.endswith("import_module") and not isinstance(arguments[0], ast.Constant)
    }
    assert homes <= IMPORTERS


def test_functions_that_import_by_name_have_no_other_names():
    """Under another name, `test_layers` would not know them."""
    stated = {name for tree in modules().values() for name in stated_names(tree)}
    assert not {"importlib.import_module", "importlib.__import__", "pkgutil.resolve_name"} & stated


@pytest.mark.full
def test_checkpoints_hold_no_code():
    """`torch.load` is called with `weights_only=True`, and numpy's reader with `allow_pickle=False`."""
    options = {}
    for tree in modules().values():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call):
                given = {each.arg: getattr(each.value, "value", None) for each in node.keywords}
                options.setdefault(name_of(node.func), []).append(given)
    assert options["torch.load"] == [{"weights_only": True}]
    assert {tuple(each.items()) for each in options["NpzFile"]} == {(("allow_pickle", False),)}


def test_paths_of_modules_are_changed_in_one_module():
    homes = {
        module for module, tree in modules().items() if any(name.startswith("sys.path.") for name, _ in calls(tree))
    }
    assert homes <= {"imports"}
