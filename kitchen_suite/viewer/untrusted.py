"""Checks of what comes from others into a page: texts that are not the suite's own, and values that browsers send."""

import math
import re
from typing import Any

import viser

# Besides letters, digits and blanks, what has no meaning in Markdown and HTML.
_PLAIN = frozenset(" .,;:'\"/+=%?^")

# What Markdown makes links of, without any mark.
_LINKS = re.compile(r"(?<=:)(?=//)|(?<=www)(?=\.)|(?=@)", re.IGNORECASE)

_SEPARATOR = "\N{ZERO WIDTH SPACE}"


def escaped(text: str) -> str:
    """Returns a text in one line that Markdown shows as it is: no markup, no HTML, no links.

    All that comes into a page and is not the suite's own goes through it: errors, which quote policies and servers,
    and names and sentences of tasks.
    """
    line = _LINKS.sub(_SEPARATOR, " ".join(text.split()))
    return "".join(map(_escaped_character, line))


def _escaped_character(character: str) -> str:
    if character.isalnum() or character in _PLAIN:
        return character
    # Control characters, and those that turn the direction of what follows, are shown by their code.
    shown = character if character.isprintable() or character == _SEPARATOR else f"\\u{ord(character):04x}"
    return "".join(each if each.isalnum() else f"&#{ord(each)};" for each in shown)


def refuse_other_values(server: viser.ViserServer) -> None:
    """Takes from the browsers of a server only values that a widget offers; all other updates change nothing.

    viser itself would take any value of the widget's type, and any other attribute of the widget as well.
    """
    # viser has no public way to see an update before it is made. These are two more private names, beside those of
    # `servers`, for which setup.cfg limits its version.
    widgets = server.gui._gui_input_handle_from_uuid  # noqa: SLF001
    update = server.gui._handle_gui_updates  # noqa: SLF001
    sockets = server._websock_server  # noqa: SLF001

    async def check(client_id: int, message: Any) -> None:
        widget = widgets.get(message.uuid)
        if widget is not None and message.updates.keys() == {"value"} and offers(widget, message.updates["value"]):
            await update(client_id, message)

    (kind,) = (kind for kind, handlers in sockets._incoming_handlers.items() if update in handlers)  # noqa: SLF001
    sockets.unregister_handler(kind, update)
    sockets.register_handler(kind, check)


def offers(widget: Any, value: object) -> bool:
    """Returns whether a widget lets a person choose a value."""
    if isinstance(widget, viser.GuiButtonHandle | viser.GuiCheckboxHandle):
        return isinstance(value, bool)
    if isinstance(widget, viser.GuiDropdownHandle | viser.GuiButtonGroupHandle):
        return isinstance(value, str) and value in widget.options
    if isinstance(widget, viser.GuiNumberHandle):
        if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            return False
        low = -math.inf if widget.min is None else widget.min
        high = math.inf if widget.max is None else widget.max
        return bool(low <= value <= high)
    return False
