# SPDX-License-Identifier: BSD-2-Clause
"""`python -m sst_pin`."""

from .cli import main

raise SystemExit(main())
