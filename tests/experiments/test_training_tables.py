from moe_policy.experiments.benchmark.published import Published
from moe_policy.experiments.seeds import TrainingRow
from moe_policy.experiments.tables import DASH, markdown_table
from moe_policy.experiments.training_tables import TRAINING_COLUMNS
from tests.experiments.test_seeds import model


def test_the_table_of_models():
    row = TrainingRow.of("moe-custom", [model(0, 985), model(1, 990), model(2, 999)], Published(success=998))
    violated = TrainingRow.of("snn", [model(0, 990, violation=0.2)], Published(violation=0.3))
    head, _, first, second = markdown_table([row, violated], TRAINING_COLUMNS).splitlines()
    assert head.startswith("| model | training problems | success, median (range) | paper |")
    assert (
        first
        == f"| moe-custom | 20 | 990 (985–999) | 998 | 495 (492–499) | {DASH} | {DASH} | {DASH} | 0.020 | 0.0100 |"
    )
    assert second == f"| snn | 20 | 990 (990–990) | {DASH} | 495 (495–495) | 0.200 | 0.300 | 0.200 | 0.020 | 0.0100 |"
