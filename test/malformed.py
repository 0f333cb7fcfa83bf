"""What anybody may ask of a driver, most of it malformed: for Hypothesis, in process and over DDS."""

from __future__ import annotations

from hypothesis import strategies as st

from jammkle_common.names import CHANNELS

LONG_NAME = "soleus " * 2000

NAME = st.one_of(st.sampled_from(CHANNELS), st.text(max_size=12), st.just(LONG_NAME))
NAMES = st.one_of(
    st.just([]),
    st.lists(st.sampled_from(CHANNELS), max_size=4),
    st.lists(NAME, max_size=4),
    st.just(["achilles"] * 500),
)
PASCALS = st.one_of(st.sampled_from((0.0, 30e3, 50e3)), st.floats(-1e5, 2e5), st.floats())
"""Often one that could be meant; else any float, NaN and infinities among them."""
