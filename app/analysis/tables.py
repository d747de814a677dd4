"""The tables of analysis.json: what each has a row for, and the columns that their names do not explain."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple


class Table(NamedTuple):
    """A table of analysis.json.

    Parameters
    ----------
    row : what it has a row for
    columns : what some of its columns hold
    """

    row: str
    columns: Mapping[str, str] = {}


TABLES: Mapping[str, Table] = {
    "scores": Table(
        "item",
        {
            "score": "natural log-odds, with sum zero in each comparison and dataset",
            "wins": "among its `n_votes`, as `losses` and `ties`",
            "ci_method": "what the interval rests on",
            "p_best": "probability to have the highest true score, by these votes alone",
            "rank_low": "first rank that the tests of pairs leave, as `rank_high` the last; together 95 %",
            "quasi_se": "error whose squares add up to that of any difference",
        },
    ),
    "scores_with_excluded": Table("item, excluded participants counted; empty if there are none"),
    "models": Table(
        "fit",
        {
            "log_nu": "tie parameter, with errors (`…_se`, `…_se_participant`), as `log_theta` and `order_effect`",
            "quasi_error": "largest relative error of a difference's error from `quasi_se`",
            "groups": "of items that votes separate or do not link",
            "bootstrap_replicates": "used; `bootstrap_without_maximum` were left out",
        },
    ),
    "tie_models": Table("way to treat ties", {"parameter": "name of the tie parameter, with its `value`"}),
    "contrasts": Table(
        "two items",
        {
            "difference": "score of `item_a` less that of `item_b`",
            "ci_simultaneous_low": "with `…_high`, the interval that holds together with those of all pairs",
            "p_holm_together": "corrected over all single datasets",
            "p_datasets": "for datasets like these, as a sample; `p_datasets_holm` is corrected",
        },
    ),
    "island_scores": Table("item of a `group` that no vote links to the others, as `scores`"),
    "island_contrasts": Table("two items of such a `group`, as `contrasts`"),
    "datasets_as_sample": Table(
        "test for datasets like these", {"f": "with `df1` and `df2` degrees of freedom", "n_datasets": "with all items"}
    ),
    "effects": Table(
        "level of a factor",
        {"n_participants": "who voted", "scope": "what the interval holds for, besides other people"},
    ),
    "tests": Table(
        "test",
        {
            "model": "the scores tested: `all` or `items` (one for each item), `additive`, or a factor",
            "g2": "takes votes as the sample, as `df` and `p_value`",
            "p_participant": "takes participants as the sample",
        },
    ),
    "groups": Table("group and item, as `scores`"),
    "triads": Table(
        "participant and dataset",
        {
            "n_items": "compared",
            "circular_by_chance": "expected of random votes, as `strict_by_chance` of strict ones with the same ties",
        },
    ),
    "random_effects": Table(
        "what differs: scores, or ties, between people, or datasets", {"sd": "standard deviation between them"}
    ),
    "random_effects_scores": Table("item"),
    "random_effects_contrasts": Table("two items", {"people_preferring": "share of people who prefer `item_a`"}),
    "lapse_scores": Table("item, careless answers weighted down"),
    "lapse_rates": Table("participant", {"lapse_rate": "share of answers given at random, as far as the votes tell"}),
    "triads_pooled": Table("participant", {"n_datasets": "that are combined"}),
    "measures": Table(
        "measure and dataset",
        {
            "n": "points",
            "n_conditions": "that permutations exchange",
            "logistic5_b1": "to `logistic5_b5`: b1 (1/2 - 1 / (1 + exp(b2 (value - b3)))) + b4 value + b5",
        },
    ),
    "measure_comparisons": Table("two measures", {"n": "points that both have"}),
    "rates": Table(
        "condition whose model's size is known",
        {
            "method": "its levels of all factors but the one of numbers, which `level` holds",
            "bytes": "of its files; over all datasets the geometric mean",
            "is_on_front": "no other is as small and scores as high",
        },
    ),
    "rate_differences": Table(
        "two methods with sizes in common",
        {
            "difference": "mean score of `method_a` less that of `method_b` at equal size, over the logarithm of sizes",
            "bytes_low": "smallest size that both have, as `bytes_high` the largest",
        },
    ),
    "agreement": Table(
        "dataset",
        {
            "u_min": "the smallest u that is possible",
            "votes_per_pair": "of all participants",
            "transitivity": "triples that violate it, among `n_triples`",
        },
    ),
    "dataset_agreement": Table("two datasets", {"n_items": "that both have"}),
    "observers": Table("participant"),
    "checks": Table(
        "participant with attention checks",
        {
            "n_identical": "pairs of a stimulus with itself, `n_identical_none` of them without preference",
            "n_repeated": "pairs shown again, `n_repeated_same` of them with the same answer",
        },
    ),
    "pairs": Table(
        "two items",
        {
            "a": "votes for `item_a`, as `b` for the other, and `none`",
            "expected_a": "by the model, as `expected_b` and `expected_none`",
        },
    ),
}
