"""Films and web pages of the episodes of a single environment."""

import contextlib
from collections.abc import Callable, Iterator

from kitchen_suite.environment import Environment
from kitchen_suite.rollouts.episode import EpisodeBuffer
from kitchen_suite.rollouts.film import Film
from kitchen_suite.rollouts.page import Page
from kitchen_suite.rollouts.settings import FilmSettings


class Views:
    """The film and the web page of a command, each if it is asked for."""

    def __init__(
        self, settings: FilmSettings, environment: Environment, *, num_episodes: int, max_steps: int | None
    ) -> None:
        """Checks that they can be made; arguments are those of `Film`.

        Raises:
          ImportError: an extra is missing.
          ValueError: there is no such camera, or the pictures are too large.
        """
        self._environment = environment
        self._film = Film(settings, environment, num_episodes=num_episodes, max_steps=max_steps)
        self._page = Page(settings, num_episodes=settings.web_episodes)

    @contextlib.contextmanager
    def open(self) -> Iterator[Callable[[EpisodeBuffer], None]]:
        """Yields a function that shows the present step."""
        with self._film.open() as film_step, self._page.open() as page_step:

            def show(buffer: EpisodeBuffer) -> None:
                film_step(buffer)
                page_step(buffer, self._environment)

            yield show
