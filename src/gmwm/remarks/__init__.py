"""Remarks: information about a result that a user should know, as data, and their conversion to sentences."""

from gmwm._template import Dialect, Fact, Quantity
from gmwm.remarks.registry import Message, messages
from gmwm.remarks.remark import Remark, sorted_remarks
from gmwm.remarks.rendering import brief, gravest, merged, texts, with_groups
from gmwm.remarks.severity import Severity

__all__ = [
    "Dialect",
    "Fact",
    "Message",
    "Quantity",
    "Remark",
    "Severity",
    "brief",
    "gravest",
    "merged",
    "messages",
    "sorted_remarks",
    "texts",
    "with_groups",
]
