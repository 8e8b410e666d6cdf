"""Texts that are not the suite's own, as a page shows them."""

import re

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
