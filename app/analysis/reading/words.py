"""Know the names of columns and the words of cells: one rule for all of them, required or optional."""

from __future__ import annotations

import re
from collections.abc import Iterable

from app.analysis.reading.votes_table import NONE, A, B


def words_of(text: str) -> tuple[str, ...]:
    """Return the words of a text."""
    return tuple(text.split())


VOTE_ROLES = ("participant", "dataset", "item_a", "item_b", "choice")
OPTIONAL = (
    *("first_shown", "trial", "response_ms", "practice", "excluded", "reason", "count", "role"),
    *("both_seen", "press_to_picture_ms", "shown_smoothly"),
)
RATING_ROLES = ("participant", "dataset", "condition", "rating")
RATING_OPTIONAL = ("protocol", "reference", "first_shown", "practice", "excluded", "reason", "role")
OTHER_ROLES = ("winner", "loser", "wins_a", "wins_b", "ties", "rank", "best", "worst", "options")
ROLES = tuple(dict.fromkeys((*VOTE_ROLES, *OPTIONAL, *RATING_ROLES, *RATING_OPTIONAL, *OTHER_ROLES)))
OWN_VOTES = set(VOTE_ROLES)  # a table with these very names is in our own format, whose words are documented

# Other names of our columns, as `plain` spells them.
SYNONYMS: dict[str, tuple[str, ...]] = {
    "participant": words_of(
        "participantid participantname judge judgeid observer observerid subject subjectid subj user userid "
        "username worker workerid rater raterid annotator annotatorid respondent respondentid responseid "
        "voter voterid viewer emailaddress pid prolificpid prolificid sessionuuid assessor evaluator proband probandid "
        "versuchsperson vp vpn vpnr vpnummer teilnehmer teilnehmerid teilnehmernr beobachter sujet observateur "
        "participante sujeto observador juge 被试 被试编号 参与者 被験者"
    ),
    "dataset": words_of(
        "scene content sequence src datasetid sceneid contentid szene sequenz inhalt scène séquence contenu escena "
        "secuencia 场景"
    ),
    "choice": words_of(
        "choices pref preferred preference winner selected vote response resp answer choose chosen picked "
        "pick decision verdict judgement judgment keyresp keyrespkeys antwort auswahl wahl präferenz entscheidung "
        "choix réponse préférence elección respuesta preferencia 选择 偏好 回答"
    ),
    "condition": (
        *("conditionid", "item", "itemid", "stimulus", "stimulusid", "stim", "pvs", "hrc", "method", "model", "system"),
        *("algorithm", "film", "video", "videoname", "videoid", "file", "filename", "ratingstimulus", "technique"),
        *("clip", "clipname", "image", "imagename", "fileurl", "videourl", "stimulusname", "cond", "stimfile"),
        *("stimulusfile", "imagefile", "videofile", "bedingung", "verfahren", "methode", "algorithmus", "méthode"),
        *("condición", "condicion", "método", "metodo", "方法", "条件", "算法", "手法"),
    ),
    "rating": words_of(
        "ratings score opinion opinionscore grade mark ratingscore ratingvalue stars bewertung évaluation puntuación "
        "puntuacion calificación 评分 分数 得分 評価"
    ),
    "practice": ("ispractice",),
    "excluded": ("isexcluded",),
    "reference": ("isreference",),
    "count": ("counts", "nvotes"),
    "wins_a": ("win1", "wins1", "winsa", "awins", "homewins", "leftwins", "winsleft", "votesa", "votes1", "counta"),
    "wins_b": ("win2", "wins2", "winsb", "bwins", "awaywins", "rightwins", "winsright", "votesb", "votes2", "countb"),
    "ties": ("tie", "draws", "draw", "ntie", "nties", "istie", "isdraw", "tied", "nopreference", "isequal"),
    "rank": ("ranking", "place", "position"),
    "winner": ("winnerid", "winnername", "winneritem", "won", "chosenmodel", "chosenitem", "preferreditem", "sieger"),
    "loser": ("loserid", "losername", "loseritem", "lost", "rejected", "rejectedmodel", "rejecteditem", "verlierer"),
    "best": ("most", "mostpreferred", "bestitem"),
    "worst": ("least", "leastpreferred", "worstitem"),
}
WEAK_RATINGS = ("vote", "response", "resp", "answer", "value", "judgement", "judgment")  # where no pair is named
BINARY_CHOICES = {  # the cell is true where item_a, or item_b, is preferred
    A: (
        *("isaselected", "isapreferred", "aselected", "apreferred", "chosea", "aischosen", "prefersa", "prefera"),
        *("isabetter", "abetter"),
    ),
    B: (
        *("isbselected", "isbpreferred", "bselected", "bpreferred", "choseb", "bischosen", "prefersb", "preferb"),
        *("isbbetter", "bbetter"),
    ),
}
TRUE_FALSE = {"1": True, "true": True, "yes": True, "0": False, "false": False, "no": False}

STEMS = (
    *("item", "condition", "cond", "stimulus", "stim", "method", "model", "option", "system", "video", "image", "img"),
    *("picture", "clip", "film", "sample", "algorithm", "algo", "technique", "alternative", "candidate", "player"),
    *("team", "object", "file", "filename", "pvs", "hrc", "film", "sequence", "name", "bild", "methode", "verfahren"),
    *("imagen", "vidéo", "méthode", "método"),
)
ABROAD = (("links", "rechts"), ("gauche", "droite"), ("izquierda", "derecha"), ("左", "右"))
ENDS = (("a", "b"), ("1", "2"), ("left", "right"), ("first", "second"), *ABROAD, ("home", "away"))
WITH_TAILS = (("left", "right"), *ABROAD)  # left_url and right_url; a first_name is a person's
MORE_ENDS = ("c", "3", "third", "middle")  # a third of a kind: not two items
TAILS = ("id", "name", "path", "url", "file")

TIES = dict.fromkeys(
    (
        *("none", "tie", "ties", "tied", "draw", "equal", "same", "both", "neither", "no preference"),
        *("nopreference", "no difference", "about the same", "the same", "equally good", "tie (bothbad)"),
        *("gleich", "kein unterschied", "unentschieden", "égal", "pas de différence", "igual", "sin diferencia"),
        *("相同", "=", "≈", "tie (both bad)", "bothbad", "both bad", "both good", "cannot decide", "can't decide"),
        "undecided",
    ),
    NONE,
)
SIDES = (("a", "b"), ("left", "right"), ("first", "second"), ("1", "2"))
STRENGTHS = {"": 2, "clearly": 2} | dict.fromkeys(("much", "far", "a lot"), 3)
STRENGTHS |= dict.fromkeys(("somewhat", "slightly", "a little", "a bit"), 1)
# "slightly better", "A is much better", "left slightly worse": ITU-T P.910's comparison categories.
STRENGTH = re.compile(
    rf"(?:(?P<who>.+?)\s+)??(?:is\s+)?(?P<much>{'|'.join(filter(None, STRENGTHS))})?\s*(?P<way>better|worse)",
    re.IGNORECASE,
)

NOT_THERE = ("NA", "na", "N/A", "n/a", "NaN", "nan", "#N/A", "NULL", "null", ".", "-")  # in the place of nothing
# What is never a person or a condition, though it stands in a column beside them.
NEVER = frozenset(
    words_of(
        "mos dmos cmos smos mosstd sd std stdev stddev standarddeviation se sem sos ci ci95 95ci 95%ci cilow cihigh "
        "cilower ciupper lower upper confidenceinterval ci90 ci99 95% n mean average avg median var variance rank "
        "ranking min max sum total age ages ageyears sex gender group country nationality language education "
        "occupation experience expertise vision acuity glasses handedness yearofbirth birthyear index nr number row "
        "line rowid time times timestamp date day datetime start end startdate enddate duration durations "
        "durationinseconds rt reactiontime responsetime responsems latency elapsed timeelapsed seconds ms hour "
        "trial trialno trialnumber trialindex trialid order position block blockno run session sessionid batch list "
        "version seed wave visit week month year device browser width height screenwidth screenheight resolution "
        "distance dpi confidence certainty difficulty fatigue mood effort progress status finished attention "
        "attentioncheck check practice training excluded exclude valid gold trap comment comments note notes remark "
        "remarks reason count weight consent role protocol reference replicates repetition rep ip ipaddress "
        "latitude longitude scene locationlatitude locationlongitude qrecaptchascore externalreference phase city "
        "zip zipcode email income height_cm cohort site lab room price reward payment bonus kurtosis skew skewness "
        "outlier outliers ratio percent iqr clicks plays replays views looks switches toggles visits position hours "
        "collectorid customdata1 "
        "familiarity gaming ssq tlx sus presence nausea sickness cybersickness discomfort workload immersion alter "
        "geschlecht edad sexo sexe mittelwert durchschnitt moyenne promedio overall stdabw stabw standardabweichung "
        "anzahl streuung varianz écarttype 平均 平均值 标准差 minimum maximum datum uhrzeit zeit zeitstempel dauer "
        "reaktionszeit fecha hora heure durée kommentar commentaire comentario bemerkung land pays país 年龄 性别 时间"
    )
) | {""}
# Rows of a wide table that are nobody.
SUMMARIES = frozenset(
    words_of(
        "mos dmos cmos sd std stdev stddev se sem ci ci95 95ci mean average avg median var variance total totals sum "
        "all overall summary mittelwert durchschnitt gesamt summe moyenne promedio count minimum maximum "
        "stdabw stabw standardabweichung varianz anzahl écarttype 平均 平均值 标准差"
    )
)
INITIALS = frozenset(words_of("sd std se sem ci var sum all"))  # of statistics, or of people
# What a column is likely to say if its name or its cells hold this: that some rows should not count, or are apart.
SUSPICIOUS = re.compile(
    r"practi[cs]|train|warm.?up|exclu|reject|discard|remove|outlier|attention|catch|trap|gold|sanity|honeypot|session|"
    r"scene|phase|\btest|check|valid|fail|screen(ed|ing|out)|control|dummy|pilot|swap|flip|mirror|revers|preview|bot\b|"
    r"spam|cheat|duplicate|trial.?type|is.?real|consent|withdr",
    re.IGNORECASE,
)
# Columns, not cells, that say so.
SUSPICIOUS_NAME = re.compile(
    r"correct|accura|expected|target|delet|inclu|keep|kept|accept|approv|pass|usable|complete|status|invert|^(ok|used?|good)$",
    re.IGNORECASE,
)
# Columns whose true rows count, and columns that tell rows apart.
COUNTS = re.compile(
    r"(?<!in)(valid|correct|accura|complete)|(?<!un)usable|inclu|keep|kept|accept|approv|pass|is.?real|consent|"
    r"^(ok|used?|good)$",
    re.IGNORECASE,
)
SEVERAL_RUNS = re.compile(r"session|scene|phase", re.IGNORECASE)
SWAPPED = re.compile(r"swap|flip|mirror|revers", re.IGNORECASE)  # sides that stand the other way round in some rows
# What may say on which side, or in which order, the items of a row were shown.
PLACED = re.compile(r"order|pos(ition)?|side|locat|placement|left|right|first|second|top|bottom", re.IGNORECASE)
MOST_PLACES = 3  # different places that an item may have
SEVERAL = re.compile(r"criteri|question|attribute|dimension|aspect|rating.?type|^scale|^task", re.IGNORECASE)
MULTIPLE = ("n", "freq", "frequency", "weight", "weights", "times", "votes", "total", "num", "number", "multiplicity")
SCALES = (  # ITU-T P.910, absolute categories, and the same in other languages
    *("excellent,good,fair,poor,bad", "ausgezeichnet,gut,ordentlich,dürftig,schlecht", "优,良,中,差,劣"),
    *("excellent,bon,assez bon,médiocre,mauvais", "excelente,buena,aceptable,mediocre,mala"),
    "excelente,bueno,regular,pobre,malo",
)
GRADES = {word: float(5 - place) for words in SCALES for place, word in enumerate(words.split(","))}
LABELLED = re.compile(r"(\d+)(?:\s*[-–—:.=()]\s*|\s+)[^\W\d]\D*")  # "5 - Excellent", "4 (good)", "3 stars"
STARS = re.compile(r"((?:[★⭐*]\ufe0f?\s*)+)((?:☆\s*)*)")  # full ones, then hollow ones
MOST_STARS = 5  # where nobody says of how many
MOST_WORDS = 12  # different texts of a column whose cells are looked at; more are names or numbers
COMMENTS = re.compile(
    r"[\s_:,;()\[\]-]+(comments?|why|reasons?|remarks?|notes?|explanation|explain|conf|confidence|certainty|certain|"
    r"strength|time|rt|ms|duration|timing|seconds|clicks?|order|first|text|other|other text|page submit|first click|"
    r"last click)[\s)\]?:.]*$",
    re.IGNORECASE,
)
NUMBERING = re.compile(
    r"^\s*(?:(?:q|question|pair|trial|task|comparison)[\s_.#]?\d+[a-z]?(?:\s*[.):\]_–—-]\s*|\s+)"  # Q1_, Pair 3:
    r"|(?:(?:p|c|t|no|nr|num|item|#)[\s_.]?)?#?\d+[a-z]?(?:[.):]\s+|\)|\s+[:–—-]\s+)"  # P1 - , 2. , 3)
    r"|[(\[]\d+[)\]]\s*)(?=\S)",  # (4)
    re.IGNORECASE,
)
HEADING = re.compile(r"^.*[?:]\s*[-–—]?\s+(?=\S)")  # "Which is better? - "
IN_BRACKETS = re.compile(r"^[^()\[\]]*[(\[]([^()\[\]]*\s(?:vs\.?|versus)\s[^()\[\]]*)[)\]]\s*$", re.IGNORECASE)
VERSUS = re.compile(r"^(.+?)\s+(?:vs\.?|versus)\s+(.+)$", re.IGNORECASE)
TIGHT_VERSUS = re.compile(r"^(.+?)_(?:vs|versus)_(.+)$", re.IGNORECASE)
DASH = re.compile(r"^(.+?)\s+(?:-|–|—|:|\||/)\s+(.+)$")
TAIL = re.compile(r"(?:\s+[-–—|]\s+|\s*[:;(\[]\s*)\S.*$")  # " - Which is better?", " (left or right)"


def plain(name: str) -> str:
    """Return a column's name as it is compared: capitals, spaces, points, hyphens and underscores do not matter."""
    return re.sub(r"[\s._-]", "", name).lower()


def stars_in(word: str) -> tuple[int, int] | None:
    """Return how many stars of a word such as ★★★☆☆ or *** are full, and how many there are; None for others."""
    match = STARS.fullmatch(word)
    if match is None:
        return None
    full, hollow = (len(re.findall(r"[★⭐*☆]", stars)) for stars in match.groups())
    return full, full + hollow


def _stars(word: str) -> int | None:
    full, n = stars_in(word) or (0, 0)
    return full if n == MOST_STARS or full == n > 0 else None


def grades_in(words: Iterable[str]) -> dict[str, float]:
    """Return the grade of each word of a scale, in lower case; empty if one has none, or if there are none but numbers.

    "Excellent" is 5, "2 - poor" is 2, three stars are 3; a number beside them is itself. A single word is rather a
    mistake, and *** what stands for a missing cell.
    """
    lower = dict.fromkeys(word.lower() for word in words)
    if len(lower) > 1 and lower.keys() <= GRADES.keys():
        return {word: GRADES[word] for word in lower}
    if lower and all(map(_stars, lower)) and (len(lower) > 1 or "*" not in min(lower)):
        return {word: float(_stars(word) or 0) for word in lower}
    numbers = {word: match[1] if (match := LABELLED.fullmatch(word)) else word for word in lower}
    is_scale = len(set(numbers.values())) == len(lower) > 1 and set(numbers.values()) != lower.keys()
    return (
        {word: float(n) for word, n in numbers.items()}
        if is_scale and all(map(str.isdecimal, numbers.values()))
        else {}
    )


def has_grade(word: str) -> bool:
    """May a word be one of a scale, as `grades_in` reads it?"""
    return word.lower() in GRADES or word.isdecimal() or bool(LABELLED.fullmatch(word) or _stars(word))


def means(role: str, name: str) -> bool:
    """Is a column of this name one of a role's: our own name, or a usual other one?"""
    return plain(name) in (plain(role), *SYNONYMS.get(role, ()))


def is_never(name: str) -> bool:
    """Is a name that of a statistic, of something about people, of a time or a number of a trial?"""
    letters = plain(name)
    bare = re.sub(r"^(is|the|participant|subject|user|your)(?=.)", "", letters)
    short = re.sub(r"(years|yrs|inyears|ms|sec|ins|\(.*\))$", "", letters)
    return letters.startswith("unnamed") or bool({letters, bare, short} & NEVER)


def is_suspicious(name: str, words: Iterable[str] = ()) -> bool:
    """Does a column that is not used look as if it said that rows should not count, or are apart?"""
    few = list(words)
    return bool(SUSPICIOUS.search(name) or SUSPICIOUS_NAME.search(name)) or (
        len(few) <= MOST_WORDS and any(SUSPICIOUS.search(word) for word in few if len(word) < 40)
    )


def ends_of(name: str) -> tuple[str, int, int] | None:
    """Read a name such as `model_a`, `left image` or `Item 1`: stem, which of `ENDS`, and side; None for others."""
    letters = plain(name)
    for tail in ("", *TAILS):
        if tail and not letters.endswith(tail):
            continue
        short = letters.removesuffix(tail)
        for place, ends in enumerate(ENDS):
            for side, end in enumerate(ends):
                for stem in {short.removesuffix(end), short.removeprefix(end)} - {short}:
                    if stem in STEMS or (not stem and (ends in WITH_TAILS or not tail) and not end.isdigit()):
                        return f"{stem}+{tail}", place, side
    return None


def pair_in(name: str) -> tuple[str, str, bool] | None:
    """Read a column's name such as "x vs y" or "P1 - x vs y" as two items, and whether a dash alone divides them."""
    bare = name.strip()
    if match := IN_BRACKETS.match(bare):
        bare = match[1].strip()
    for divided in (VERSUS, TIGHT_VERSUS, DASH):
        match = divided.match(bare)
        if match is None:
            continue
        for heading in (HEADING, NUMBERING) if divided is not DASH else (NUMBERING,):
            cut = heading.sub("", bare, count=1)
            if cut != bare and divided.match(cut) and not heading.match(match[2]):
                bare = cut
                match = divided.match(bare) or match
        return match[1].strip(), match[2].strip(), divided is DASH
    return None


def pairs_in(names: Iterable[str]) -> dict[str, tuple[str, str, bool]]:
    """Read the names of columns that are pairs, as `pair_in` does, without the question that all of them end with."""
    pairs = {name: pair for name in names if (pair := pair_in(name)) is not None}
    tails = {match[0] if (match := TAIL.search(second)) else "" for _, second, _ in pairs.values()}
    tail = tails.pop() if len(tails) == 1 else ""
    is_question = tail.rstrip(")]").endswith("?") or len(pairs) > 1
    if not tail or not is_question or any(first.endswith(tail) for first, _, _ in pairs.values()):
        return pairs
    return {name: (first, second.removesuffix(tail), is_dash) for name, (first, second, is_dash) in pairs.items()}
