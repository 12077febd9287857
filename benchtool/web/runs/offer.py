"""What of a thing in the runs folder can be taken home: tables, reports, files. Pure."""

from __future__ import annotations

from dataclasses import dataclass

from benchtool.store.entry import ANSWER_FILE, FIT_FILE, Entry
from benchtool.store.export import TABLES


@dataclass(frozen=True, slots=True, kw_only=True)
class Offer:
    """Offer one file.

    Attributes:
        label: on its button.
        file: what it is called at home.
        table: a table of a run, to be exported; empty for others.
        path: a file that stands in the runs folder, by its name there; empty for others.
        report: whether it is the report.
    """

    label: str
    file: str
    table: str = ""
    path: str = ""
    report: bool = False

    @property
    def suffix(self) -> str:
        """Ending of the file, with its point."""
        return f".{self.file.rsplit('.', 1)[-1]}"


def offers(entry: Entry) -> tuple[Offer, ...]:
    """Return what an entry offers; nothing that cannot be read offers anything."""
    if entry.problem:
        return ()
    flat = entry.name.replace("/", "-")
    if entry.kind == "table":
        return (Offer(label="CSV", file=flat, path=entry.name),)
    if entry.kind == "recording":
        return (report_offer(flat), Offer(label="Recording", file=flat, path=entry.name))
    if entry.kind in ("fit", "explanation"):
        kept = [FIT_FILE if entry.kind == "fit" else ANSWER_FILE]
        if entry.state not in ("stopped early", "not converged"):
            kept.append("model.toml")
        return (
            report_offer(flat),
            *(
                Offer(label=file, file=f"{flat}-{file}", path=f"{entry.name}/{file}")
                for file in kept
            ),
        )
    tables = TABLES if entry.kind == "sweep" else ("samples",)
    return (
        report_offer(flat),
        *(
            Offer(label=f"{table}, CSV", file=f"{flat}-{table}.csv", table=table)
            for table in tables
        ),
        Offer(label="samples, Parquet", file=f"{flat}-samples.parquet", table="samples"),
    )


def report_offer(name: str) -> Offer:
    """Return the report of something."""
    return Offer(label="Report, HTML", file=f"{name}-report.html", report=True)
