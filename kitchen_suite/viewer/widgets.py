"""Checks of the values that browsers send to the widgets of a page."""

import math
from typing import Any

import viser


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
