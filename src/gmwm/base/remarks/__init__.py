"""Remarks: information about a result that a user should know, as data, and their conversion to sentences."""

from gmwm.base.remarks.registry import Message, Severity, messages
from gmwm.base.remarks.remark import Remark, sorted_remarks
from gmwm.base.remarks.rendering import brief, codes_text, explanation, gravest, merged, texts, with_groups
from gmwm.base.template import Dialect, Fact, Quantity

__all__ = [
    "Dialect", "Fact", "Message", "Quantity", "Remark", "Severity", "brief", "codes_text", "explanation", "gravest",
    "merged", "messages", "sorted_remarks", "texts", "with_groups",
]  # fmt: skip
