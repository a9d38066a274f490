"""Leave out the doctests of the page of `gmwm app` without the extra `app`."""

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("dash") else ["gmwm/applications/app/page/*.py"]
