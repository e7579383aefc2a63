"""Images of pages in a browser: `python tests/page_image.py view CACHE|tune PRESET -o FILE.png`.

Needs Chromium. The page is opened after a second of its own clock.
"""

import shutil
import subprocess
import sys
import tempfile

SIZE = "960,600"
SECONDS = 15  # of the page's clock, in which it loads and draws


def draw(command: str, source: str, output: str) -> None:
    """Serve a cache or a preset and take the image of its page."""
    browser = shutil.which("chromium") or shutil.which("chromium-browser") or "chrome"
    serve = [sys.executable, "-m", "featherfx", command, source, "--no-browser"]
    with (
        tempfile.TemporaryDirectory() as profile,
        subprocess.Popen(
            serve, stderr=subprocess.STDOUT, stdout=subprocess.PIPE, text=True
        ) as page,
    ):
        address = next(line for line in page.stdout if "http://" in line)
        address = "http://" + address.partition("http://")[2].split()[0]
        options = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader"]
        options += ["--enable-unsafe-swiftshader", f"--user-data-dir={profile}"]
        options += [f"--window-size={SIZE}", f"--timeout={1000 * SECONDS}"]
        image = [browser, *options, f"--screenshot={output}", address]
        subprocess.run(image, check=True, stderr=subprocess.DEVNULL)
        page.terminate()


if __name__ == "__main__":
    draw(sys.argv[1], sys.argv[2], sys.argv[sys.argv.index("-o") + 1])
