"""The report: one page, complete, self-contained, and safe whatever the bag says."""

from __future__ import annotations

import base64
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import matplotlib.image
import pytest
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from ft_manip_interfaces.msg import JointFault, Task, TaskGoal
from ft_manip_ros.bags.definitions import message_definition
from ft_manip_ros.bags.reader import open_bag
from ft_manip_ros.bags.report_data import collect
from ft_manip_ros.bags.writer import BagWriter
from ft_manip_ros.cli.main import main
from support.cdr import cdr, type_name_of

CASE = Path(__file__).resolve().parents[2] / 'bags' / 'locked_joint' / 'bag'
BROWSERS = ('chromium', 'chromium-browser', 'google-chrome', 'chrome', 'firefox')
_VOID = {'meta', 'img', 'br'}


class Page(HTMLParser):
    """Text by element, with a check that elements are closed in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.headings: list[str] = []
        self.cells: list[str] = []
        self.sources: list[str] = []
        self.tags: set[str] = set()
        self.feed(text)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag not in _VOID:
            self.open.append(tag)
        if tag == 'td':
            self.cells.append('')
        self.sources += [v or '' for k, v in attrs if k in ('src', 'href')]

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self.open and self.open[-1] in ('h1', 'h2'):
            self.headings.append(data)
        if self.open and self.open[-1] == 'td':
            self.cells[-1] += data


@pytest.fixture(scope='module')
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('report')
    assert main(['report', str(CASE), '--output', str(folder)]) == 0
    return folder


def test_the_page_tells_the_whole_story(report: Path) -> None:
    page = Page((report / 'report.html').read_text())
    assert {'Timeline', 'Joints', 'Tool path', 'About this bag'} <= set(page.headings)
    cells = ' '.join(page.cells)
    for text in ('joint_3 LOCKED at', 'plan with joint_3 frozen', 'member', 'non_member',
                 'reachable', '/joint_states', 'failure injected'):  # fmt: skip
        assert text in cells
    times = [float(cell) for cell in page.cells[: 3 * 6 : 3]]
    assert times == sorted(times)


def test_the_page_needs_nothing_else(report: Path) -> None:
    text = (report / 'report.html').read_text()
    page = Page(text)
    assert page.sources
    assert all(source.startswith('data:image/png;base64,') for source in page.sources)
    assert 'http' not in re.sub(r'base64,[^"]*', '', text)
    pictures = {base64.b64decode(source.partition(',')[2]) for source in page.sources}
    assert pictures == {path.read_bytes() for path in report.glob('*.png')}
    for path in report.glob('*.png'):
        pixels = matplotlib.image.imread(path)
        assert min(pixels.shape[:2]) > 200
        assert pixels[..., :3].std() > 0.01


def test_a_browser_shows_the_page(report: Path, tmp_path: Path) -> None:
    browser = next((found for name in BROWSERS if (found := shutil.which(name))), None)
    if browser is None:
        pytest.skip(f'no browser here (looked for {", ".join(BROWSERS)})')
    shot = tmp_path / 'shot.png'
    command = [browser, '--headless', '--no-sandbox', f'--screenshot={shot}']
    if 'firefox' in browser:
        command = [browser, '--headless', '--screenshot', str(shot)]
    subprocess.run([*command, (report / 'report.html').as_uri()], check=True, timeout=120)
    assert matplotlib.image.imread(shot)[..., :3].std() > 0.01


def test_what_the_bag_says_is_shown_not_run(tmp_path: Path) -> None:
    evil = '<script>alert("x")</script>'
    messages = {
        '/fault_events': JointFault(name='a', state=JointFault.LOCKED, cause=evil),
        '/task': Task(name=evil, goals=[TaskGoal(id='<b>')]),
        '/joint_states': JointState(name=['a', '$x_', '$$o_2'], position=[float('nan'), 1.0, 2.0]),
        '/joint_trajectory_controller/joint_trajectory': JointTrajectory(joint_names=['a', '$x_']),
    }
    with BagWriter(tmp_path / 'bag') as writer:
        writer.add_provenance('ft_manip_ros', {'note': evil})
        for i, (topic, message) in enumerate(messages.items()):
            definition = message_definition(type_name_of(message))
            writer.write(writer.add_topic(topic, definition), cdr(message), 10**18 + i)
    assert main(['report', str(tmp_path / 'bag'), '--output', str(tmp_path / 'out')]) == 0
    text = (tmp_path / 'out' / 'report.html').read_text()
    page = Page(text)
    assert 'script' not in page.tags
    assert 'b' not in page.tags
    assert any(evil in cell for cell in page.cells)
    assert 'no tool path' in text


def test_unreadable_messages_are_noted(tmp_path: Path) -> None:
    with BagWriter(tmp_path / 'bag') as writer:
        definition = message_definition('sensor_msgs/msg/JointState')
        key = writer.add_topic('/joint_states', definition)
        writer.write(key, cdr(JointState(name=['a'], position=[1.0])), 10**18)
        for i in range(3):
            writer.write(key, b'\x00\x01\x00\x00', 10**18 + i)
    data = collect(open_bag(tmp_path / 'bag'))
    assert any('3 messages are not readable' in note for note in data.notes)
    assert data.joints['a'][1].tolist() == [1.0]


def test_readings_that_no_picture_can_show_are_left_out(tmp_path: Path) -> None:
    messages = [
        *(JointState(name=['a', 'b'], position=[x, 0.5]) for x in (1.0, 1e184, -1e20, 1.1)),
        JointTrajectory(
            joint_names=['a'], points=[JointTrajectoryPoint(positions=[x]) for x in (1.0, 1e300)]
        ),
        JointFault(name='a', state=JointFault.LOCKED, frozen_position=-1e200),
    ]
    topic_of = {JointState: '/joint_states', JointFault: '/fault_events'}
    with BagWriter(tmp_path / 'bag') as writer:
        for i, message in enumerate(messages):
            topic = topic_of.get(type(message), '/joint_trajectory_controller/joint_trajectory')
            definition = message_definition(type_name_of(message))
            writer.write(writer.add_topic(topic, definition), cdr(message), 10**18 + i)
    assert main(['report', str(tmp_path / 'bag'), '--output', str(tmp_path / 'out')]) == 0
    assert 'readings beyond 1e+06 of a<' in (tmp_path / 'out' / 'report.html').read_text()
    data = collect(open_bag(tmp_path / 'bag'))
    assert data.joints['a'][1].tolist() == [1.0, 1.1]
    assert data.joints['b'][1].tolist() == [0.5] * 4


@pytest.mark.parametrize(
    ('bag', 'problem'), [('none', 'does not exist'), ('empty', 'no messages')]
)
def test_nothing_to_report_on(
    bag: str, problem: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    BagWriter(tmp_path / 'empty').close()
    assert main(['report', str(tmp_path / bag), '--output', str(tmp_path / 'out')]) == 2
    assert problem in capsys.readouterr().err
    (tmp_path / 'file').write_text('')
    assert main(['report', str(CASE), '--output', str(tmp_path / 'file')]) == 2
    assert 'cannot be written' in capsys.readouterr().err
