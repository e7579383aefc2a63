"""Pages of the texts that studies are held against, as their own tables of contents have them.

Where a text lists its tables and figures that is their page; else it is the range from the first
page of the section that holds them to that of the next.
"""

from __future__ import annotations

import re

_JOUVE = {
    "equation 4.1": "47-49",
    "equation A.5": "88-89",
    "equation 6.6": "78-79",
    "figure 5.8": "59-64",
    "figure 6.6": "75-78",
    "figure 6.8": "78-83",
    "figure D.3": "102-106",
    "section 3.3": "38-47",
    "section D.3": "103-106",
    "table 5.1": "59-64",
    "table 5.2": "64-67",
    "table D.2": "106-108",
}
_HOUGHTON = {
    "equation 5.35": "84-89",
    "equation 6.24": "106-109",
    "equation 6.31": "111-113",
    "equation 6.34": "111-113",
    "equation 6.35": "126-128",
    "figure 5.14": "95",
    "figure 6.16": "121",
    "figure 6.17": "122",
    "figure 6.19": "123",
    "figure 6.20": "124",
    "figure 6.24": "126",
    "figure 6.25": "127",
    "figure 6.26": "129",
    "figure 6.28": "129",
    "section 2.2.4": "28-31",
    "section 5.3.1": "84-89",
    "section 5.4.1": "93-96",
    "section 7.1": "137-140",
    "table 5.1": "83",
    "table 5.2": "83",
    "table 5.3": "84",
    "table 5.4": "89",
    "table 5.5": "92",
    "table 5.6": "97",
    "table 6.3": "131",
    "table 6.5": "134",
    "table 6.6": "134",
    "table 6.7": "135",
    "table 6.8": "135",
}
_JACQUEMOUD = {
    "figure 4-15": "177-193",
    "figure 4-16": "177-193",
    "section 4.5.2.2": "177-193",
    "table A5-3": "253-270",
}
PAGES = {"Jouve 2024": _JOUVE, "Houghton 2020": _HOUGHTON, "Jacquemoud 2007": _JACQUEMOUD}
_PLACE = re.compile(
    r"(?:\b(table|figure|equation|section)s? |(?<= and )|(?<=, ))((?:[A-E]?\d+[.-])+\d+|[A-E]\.\d+)"
)


def with_pages(text: str) -> str:
    """The source of a number, with the page behind each table, figure, equation or section.

    Raises KeyError for a place in one of these texts whose page is not listed here.
    """
    pages = PAGES.get(text.split(",")[0])
    if pages is None:
        return text
    kind = ""

    def paged(found: re.Match[str]) -> str:
        nonlocal kind
        kind = found[1] or kind
        page = pages[f"{kind} {found[2]}"]
        return f"{found[0]} ({'pp.' if '-' in page else 'p.'} {page})"

    return _PLACE.sub(paged, text)
