import pytest


@pytest.fixture
def drawn(request, monkeypatch):
    """Calls a function of the test module's ``figures`` and returns its Matplotlib figure instead of a file."""
    from matplotlib.figure import Figure

    made = []

    def capture(path, size, draw):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        made.append(figure)
        return path

    def call(function, *arguments, **options):
        function("unused.png", *arguments, **options)
        return made[-1]

    monkeypatch.setattr(request.module.figures, "save_figure", capture)
    return call
