"""From a run folder to one self-contained HTML report: data reads, figures draw, tables tabulate, render writes."""
