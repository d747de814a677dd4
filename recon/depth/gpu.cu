// The heavy steps of matching on a GPU, the same operations in the same order as on the processor: `permeability.py`,
// `slanted.py`, `plane_search.py` and `census.py` say what they do and why. Compiled without contraction of products
// and sums, so that every number is rounded as there.
//
// Sixteen threads are a group: where the processor holds sixteen disparities, or places of a window's row, in one
// register, each thread holds one, its lane, and takes others' by shuffles. All threads of a group take the same way.

typedef unsigned char uint8;
typedef unsigned short uint16;
typedef unsigned int uint32;

constexpr int N_LANES = 16;

__device__ int lane() { return threadIdx.x % N_LANES; }

__device__ int group() { return (blockIdx.x * blockDim.x + threadIdx.x) / N_LANES; }

__device__ uint32 members() { return 0xFFFFu << (threadIdx.x & 16); }

__device__ float from_lane(float number, int which) { return __shfl_sync(members(), number, which, N_LANES); }

__device__ float infinity() { return __int_as_float(0x7F800000); }

__device__ int clamped(int number, int lowest, int highest) { return min(max(number, lowest), highest); }

__device__ float clamped(float number, float lowest, float highest) { return fminf(fmaxf(number, lowest), highest); }

// ---- census codes ----

// One thread for each code of a view, framed: outside the picture the outermost code is repeated.
extern "C" __global__ void census(const uint16* grey, const uint8* mask, int height, int width, int radius,
                                  int is_right, int before, int pitch, uint32 behind, uint32* codes) {
    const int column = blockIdx.x * blockDim.x + threadIdx.x, y = blockIdx.y;
    if (column >= pitch) return;
    const int seen = clamped(column - before, 0, width - 1), x = is_right ? width - 1 - seen : seen;
    const uint16 centre = grey[y * width + x];
    uint32 code = 0;
    for (int v = -radius; v <= radius; ++v)
        for (int u = -radius; u <= radius; ++u)
            if (u || v) {
                const uint16 neighbour = grey[clamped(y + v, 0, height - 1) * width + clamped(x + u, 0, width - 1)];
                code = code << 1 | (neighbour < centre);
            }
    codes[y * pitch + column] = mask[y * width + x] ? code : code | behind;
}

// ---- what both aggregations share ----

struct View {
    const uint32 *sharp, *blurred, *facing_sharp, *facing_blurred;  // codes, see `aggregate_and_choose`
    int pitch, facing_pitch, before, origin;                         // of both, framed
    const uint8 *across, *down;
    const float* passage;
    int height, width;

    // The Hamming distance of pixel (y, x) to the pixel that it faces at a disparity index.
    __device__ float cost(int y, int x, int index) const {
        const int here = y * pitch + before + x, there = y * facing_pitch + origin + width - 1 - x + index;
        return float(__popc(sharp[here] ^ facing_sharp[there]) + __popc(blurred[here] ^ facing_blurred[there]));
    }
    __device__ float to_right(int y, int x) const { return passage[across[y * width + x]]; }
    __device__ float to_below(int y, int x) const { return passage[down[y * width + x]]; }
};

// The lowest of the lanes first to last, as `lanes.lowest`.
__device__ int lowest_key(float number, int first, int last, int flip) {
    const bool is_allowed = first <= lane() && lane() <= last;
    int key = is_allowed ? (__float_as_int(number) & -N_LANES) | (lane() ^ flip) : 0x7FFFFFFF;
    for (int distance = N_LANES / 2; distance; distance /= 2)
        key = min(key, __shfl_xor_sync(members(), key, distance, N_LANES));
    return key;
}

// The vertex of the parabola through the costs at a lane and its neighbours, as `subpixel.vertex`.
__device__ float vertex(float costs, int which) {
    const float before = from_lane(costs, which - 1), here = from_lane(costs, which);
    const float after = from_lane(costs, which + 1), bend = before - 2.0f * here + after;
    return bend <= 0 ? 0.0f : clamped(0.5f * (before - after) / bend, -MAX_OFFSET, MAX_OFFSET);
}

// ---- the permeability filter ----

struct Tiles {
    const int* start;
    const float *rise, *fall;
    int bits, n_columns;

    __device__ int at(int y, int x) const { return (y >> bits) * n_columns + (x >> bits); }
};

// Another window on the same costs, the outermost repeated.
__device__ float shifted(float costs, int shift) { return from_lane(costs, clamped(lane() + shift, 0, N_LANES - 1)); }

// The same surface one pixel further on.
__device__ float tilted(float costs, float rise) {
    const float up = from_lane(costs, max(lane() - 1, 0)), down = from_lane(costs, min(lane() + 1, N_LANES - 1));
    if (rise > 0) return __fmaf_rn(rise, up, __fmaf_rn(-rise, costs, costs));
    if (rise < 0) return __fmaf_rn(-rise, down, __fmaf_rn(rise, costs, costs));
    return costs;
}

// What the pixel above a pixel passes on to it.
__device__ float from_above(const Tiles& tiles, const float* flows, int width, int y, int x, int window) {
    const int tile = tiles.at(y - 1, x);
    const float above = flows[((y - 1) * size_t(width) + x) * N_LANES + lane()];
    return tilted(shifted(above, window - tiles.start[tile]), tiles.fall[tile]);
}

// One group for each row: costs flow to the right and to the left.
extern "C" __global__ void flow_along_rows(View view, Tiles tiles, float* flows) {
    const int y = group();
    if (y >= view.height) return;
    float* row = flows + y * size_t(view.width) * N_LANES + lane();
    float flow = 0, open = 0;
    int window = tiles.start[tiles.at(y, 0)];
    for (int x = 0; x < view.width; ++x) {
        const int start = tiles.start[tiles.at(y, x)];
        flow = shifted(flow, start - window);
        window = start;
        if (x > 0) flow = tilted(flow, tiles.rise[tiles.at(y, x - 1)]);
        flow = __fmaf_rn(open, flow, view.cost(y, x, window + lane()));
        row[x * N_LANES] = flow;
        open = view.to_right(y, x);
    }
    flow = 0;
    for (int x = view.width - 1; x >= 0; --x) {
        const int start = tiles.start[tiles.at(y, x)];
        flow = tilted(shifted(flow, start - window), -tiles.rise[tiles.at(y, x)]);
        window = start;
        open = view.to_right(y, x);
        row[x * N_LANES] = __fmaf_rn(open, flow, row[x * N_LANES]);
        flow = __fmaf_rn(open, flow, view.cost(y, x, window + lane()));
    }
}

// One group for each column: what flowed along rows flows down and up, and the cheapest disparity is kept.
extern "C" __global__ void choose_along_columns(View view, Tiles tiles, int n_disparities, int flip, float* flows,
                                                int* best, float* chosen) {
    const int x = group();
    if (x >= view.width) return;
    for (int y = 1; y < view.height; ++y) {
        const int window = tiles.start[tiles.at(y, x)];
        const float above = from_above(tiles, flows, view.width, y, x, window);
        float* here = flows + (y * size_t(view.width) + x) * N_LANES + lane();
        *here = __fmaf_rn(view.to_below(y - 1, x), above, *here);
    }
    float upward = 0;
    for (int y = view.height - 1; y >= 0; --y) {
        const int tile = tiles.at(y, x), window = tiles.start[tile];
        const int below = y + 1 < view.height ? tiles.start[tiles.at(y + 1, x)] : window;
        upward = tilted(shifted(upward, window - below), -tiles.fall[tile]);
        const float held = flows[(y * size_t(view.width) + x) * N_LANES + lane()];
        const float total = __fmaf_rn(view.to_below(y, x), upward, held);
        upward = total;
        if (y > 0)
            upward = __fmaf_rn(-view.to_below(y - 1, x), from_above(tiles, flows, view.width, y, x, window), total);
        const int last = min(n_disparities - window, N_LANES) - 1 - (window + N_LANES < n_disparities);
        const int key = lowest_key(total, window != 0, last, flip), place = y * view.width + x;
        if ((key & -N_LANES) < (best[place] & -N_LANES)) {
            const int which = (key & (N_LANES - 1)) ^ flip, index = window + which;
            const float offset = 0 < index && index < n_disparities - 1 ? vertex(total, which) : 0.0f;
            if (lane() == 0) {
                best[place] = key;
                chosen[place] = float(index) + offset;
            }
        }
    }
}

// ---- aggregation along a surface ----

__device__ bool is_same_surface(float here, float there) { return fabsf(here - there) <= SURFACE_STEP; }

// The cost of a lane around a surface, between two whole disparities.
__device__ float cost_around(const View& view, const float* surface, int y, int x) {
    const float whole = floorf(surface[y * view.width + x]), part = surface[y * view.width + x] - whole;
    const int index = int(whole) - CENTRE + lane();
    const float cost = view.cost(y, x, index), next = lane() + 1 < N_LANES ? view.cost(y, x, index + 1) : cost;
    return __fmaf_rn(-part, cost, __fmaf_rn(part, next, cost));
}

// One group for each row: costs around the surface flow to the right and to the left.
extern "C" __global__ void surface_along_rows(View view, const float* surface, float* flows) {
    const int y = group();
    if (y >= view.height) return;
    const float* heights = surface + y * view.width;
    float* row = flows + y * size_t(view.width) * N_LANES + lane();
    float flow = 0;
    for (int x = 0; x < view.width; ++x) {
        const bool is_open = x > 0 && is_same_surface(heights[x], heights[x - 1]);
        flow = __fmaf_rn(is_open ? view.to_right(y, x - 1) : 0.0f, flow, cost_around(view, surface, y, x));
        row[x * N_LANES] = flow;
    }
    flow = 0;
    for (int x = view.width - 1; x >= 0; --x) {
        const bool is_open = x + 1 < view.width && is_same_surface(heights[x + 1], heights[x]);
        const float open = is_open ? view.to_right(y, x) : 0.0f;
        row[x * N_LANES] = __fmaf_rn(open, flow, row[x * N_LANES]);
        flow = __fmaf_rn(open, flow, cost_around(view, surface, y, x));
    }
}

// One group for each column: costs flow down and up, and the surface moves to where they are lowest.
extern "C" __global__ void surface_along_columns(View view, const float* surface, int n_disparities, float* flows,
                                                 float* refined) {
    const int x = group(), width = view.width;
    if (x >= width) return;
    float* column = flows + x * N_LANES + lane();
    const size_t pitch = size_t(width) * N_LANES;
    for (int y = 1; y < view.height; ++y)
        if (is_same_surface(surface[y * width + x], surface[(y - 1) * width + x]))
            column[y * pitch] = __fmaf_rn(view.to_below(y - 1, x), column[(y - 1) * pitch], column[y * pitch]);
    float upward = 0;
    for (int y = view.height - 1; y >= 0; --y) {
        const float here = surface[y * width + x];
        float total = column[y * pitch];
        if (y + 1 < view.height && is_same_surface(surface[(y + 1) * width + x], here))
            total = __fmaf_rn(view.to_below(y, x), upward, total);
        upward = total;
        if (y > 0 && is_same_surface(here, surface[(y - 1) * width + x]))
            upward = __fmaf_rn(-view.to_below(y - 1, x), column[(y - 1) * pitch], total);
        const int which = lowest_key(total, CENTRE - MOST_MOVED, CENTRE + MOST_MOVED, 0) & (N_LANES - 1);
        const float moved = here + float(which - CENTRE) + vertex(total, which);
        if (lane() == 0) refined[y * width + x] = clamped(moved, 0.0f, float(n_disparities - 1));
    }
}

// ---- the search of PatchMatch ----

constexpr int N_ROWS = WINDOW_REACH + 1;
constexpr int GROUPS = 8;  // of a block, at most

struct Plane {
    float disparity, across, down;

    // The same plane at a pixel u columns and v rows away.
    __device__ float at(float u, float v) const { return disparity + across * u + down * v; }
};

struct Seen {
    const uint32* colours;  // see `Texture`
    const int *words, *target;
    int half;               // places of even or odd columns
    const uint8 *across, *down;
    const float* passage;
    int height, width;
};

struct Settings {
    float lowest, highest, first_step, fall, gradient_share, grey_limit, gradient_limit, smoothness, distance_limit;
};

struct Best {
    Plane plane;
    float cost, energy;
};

// A pixel, and this lane's taps of its window.
struct Window {
    int y, x;
    float weight;  // of all taps
    float* weights;
    int* words;  // of the tap in row k at k * blockDim.x
};

__device__ float total(float number) {
    for (int distance = N_LANES / 2; distance; distance /= 2)
        number += __shfl_xor_sync(members(), number, distance, N_LANES);
    return number;
}

__device__ float lower_half(int word) { return float(word & 0xFFFF); }

__device__ float upper_half(int word) { return float(word >> 16); }

__device__ int byte_distance(uint32 first, uint32 second) {
    int sum = 0;
    for (int shift = 0; shift < 32; shift += 8) sum += abs(int(first >> shift & 0xFF) - int(second >> shift & 0xFF));
    return sum;
}

__device__ float truncated_difference(float first, float second, float limit) {
    const float difference = fabsf(first - second);
    return difference < limit ? difference : limit;
}

// 2 to the power of minus number * fall / 2 ** 23, as `lanes.falling`.
__device__ float falling(float number, float fall) {
    return __int_as_float(ONE_BITS - int(fminf(number * fall, float(ONE_BITS))));
}

__device__ void take_window(const Seen& seen, const Settings& settings, Window& window) {
    const int x = window.x;
    const uint32 centre = seen.colours[(window.y * 2 + ((x + PAD) & 1)) * seen.half + ((x + PAD) >> 1)];
    float sum = 0;
    for (int row = 0; row < N_ROWS; ++row) {
        const int line = window.y + 2 * row - WINDOW_REACH, column = x + PAD - WINDOW_REACH + (row & 1);
        if (line < 0 || line >= seen.height) continue;
        const int place = (line * 2 + (column & 1)) * seen.half + (column >> 1) + lane();
        const float weight = falling(float(byte_distance(centre, seen.colours[place])), settings.fall);
        window.weights[row * blockDim.x] = weight;
        window.words[row * blockDim.x] = seen.words[place];
        sum += weight;
    }
    window.weight = total(sum);
}

// The window's mean cost along a plane, from its middle row outwards; infinity once above `enough`.
__device__ float window_cost(const Seen& seen, const Settings& settings, const Window& window, Plane plane,
                             float enough) {
    const int last = FINE * (seen.width - 1);
    const float step = float(2 * FINE) * (plane.across - 1.0f), limit = enough * window.weight;
    float sum = 0;
    for (int order = 0; order < N_ROWS; ++order) {
        const int row = N_ROWS / 2 + (order & 1 ? (order + 1) / 2 : -(order / 2));
        const int line = window.y + 2 * row - WINDOW_REACH;
        if (line < 0 || line >= seen.height) continue;
        const float u = float(-WINDOW_REACH + (row & 1)), disparity = plane.at(u, float(2 * row - WINDOW_REACH));
        const float begin = float(FINE) * (float(seen.width - 1 - window.x) - u + disparity);
        const int column = clamped(int(rintf(__fmaf_rn(step, float(lane()), begin))), 0, last);
        const int there = seen.target[line * (last + 1) + column], here = window.words[row * blockDim.x];
        const float grey = truncated_difference(lower_half(here), lower_half(there), settings.grey_limit);
        const float slope = truncated_difference(upper_half(here), upper_half(there), settings.gradient_limit);
        const float cost = __fmaf_rn(settings.gradient_share, slope - grey, grey);
        sum += window.weights[row * blockDim.x] * cost;
        if ((order & 3) == 3 && total(sum) > limit) return infinity();
    }
    return total(sum) / window.weight;
}

__device__ Plane plane_at(const float* planes, int place) {
    return Plane{planes[3 * place], planes[3 * place + 1], planes[3 * place + 2]};
}

// The distance between two planes at both pixels, truncated.
__device__ float gap(Plane plane, Plane neighbour, float u, float v, float limit) {
    const float there = fabsf(plane.at(u, v) - neighbour.disparity);
    const float here = fabsf(neighbour.disparity - neighbour.across * u - neighbour.down * v - plane.disparity);
    return fminf(there + here, limit);
}

// How far a plane is from those of the four neighbours, where the picture is smooth.
__device__ float roughness(const Seen& seen, const Settings& settings, const float* planes, const Window& window,
                           Plane plane) {
    const int x = window.x, y = window.y, width = seen.width, place = y * width + x;
    const float limit = settings.distance_limit;
    float rough = 0;
    if (x > 0) rough += seen.passage[seen.across[place - 1]] * gap(plane, plane_at(planes, place - 1), -1, 0, limit);
    if (x + 1 < width) rough += seen.passage[seen.across[place]] * gap(plane, plane_at(planes, place + 1), 1, 0, limit);
    if (y > 0)
        rough += seen.passage[seen.down[place - width]] * gap(plane, plane_at(planes, place - width), 0, -1, limit);
    if (y + 1 < seen.height)
        rough += seen.passage[seen.down[place]] * gap(plane, plane_at(planes, place + width), 0, 1, limit);
    return settings.smoothness * rough;
}

// Keep a trial if its energy is lower.
__device__ void try_plane(const Seen& seen, const Settings& settings, const float* planes, const Window& window,
                          Plane trial, Best& best) {
    trial.disparity = clamped(trial.disparity, settings.lowest, settings.highest);
    trial.across = clamped(trial.across, -MAX_SLOPE, MAX_SLOPE);
    trial.down = clamped(trial.down, -MAX_SLOPE, MAX_SLOPE);
    const float slopes = fabsf(trial.across - best.plane.across) + fabsf(trial.down - best.plane.down);
    if (fabsf(trial.disparity - best.plane.disparity) + float(SAME_WITHIN) * slopes < SAME_PLANE) return;
    const float rough = roughness(seen, settings, planes, window, trial);
    if (rough >= best.energy) return;
    const float cost = window_cost(seen, settings, window, trial, best.energy - rough);
    if (cost + rough >= best.energy) return;
    best = Best{trial, cost, cost + rough};
}

__device__ uint32 next_random(uint32 state) {
    state ^= state << 13;
    state ^= state >> 17;
    return state ^ state << 5;
}

__device__ float signed_unit(uint32 state) { return float(state >> 8) / 8388608.0f - 1.0f; }

// How far a trial changes the plane at most.
__device__ float step_of(const Settings& settings, int number, int turn) {
    return settings.first_step / float(1 << (turn / 2 % ROUND + ROUND * (number - N_NEIGHBOURS - 1)));
}

__device__ void neighbour(int number, int x, int y, int& column, int& row) {
    const int distances[] = NEIGHBOURS, distance = number & 1 ? -distances[number >> 2] : distances[number >> 2];
    column = x + (number & 2 ? 0 : distance);
    row = y + (number & 2 ? distance : 0);
}

// The trials that are worth it, a bit each.
__device__ int news_of(const Seen& seen, const Settings& settings, const short* others_moved, const short* moved,
                       int turn, int y, int x, float disparity) {
    const int width = seen.width;
    int news = 0, row, column;
    for (int number = 0; number < N_NEIGHBOURS; ++number) {
        neighbour(number, x, y, column, row);
        const bool is_inside = 0 <= row && row < seen.height && 0 <= column && column < width;
        const int since = number < 4 ? turn - 1 : max(turn - 1, 1);
        if (is_inside && moved[row * width + column] >= since) news |= 1 << number;
    }
    const bool is_moving = moved[y * width + x] >= turn - 3;
    const int there = width - 1 - x + int(rintf(disparity));
    if (0 <= there && there < width && (is_moving || others_moved[y * width + there] >= (turn | 1) - 3))
        news |= 1 << N_NEIGHBOURS;
    for (int number = N_NEIGHBOURS + 1; is_moving && number < N_TRIALS; ++number)
        if (step_of(settings, number, turn) > LAST_STEP) news |= 1 << number;
    return news;
}

// One group for each pixel of one colour of the chessboard, as `plane_search.sweep`.
extern "C" __global__ void sweep(Seen seen, Settings settings, const float* others, const short* others_moved,
                                 int turn, uint32 seed, float* planes, float* costs, short* moved) {
    __shared__ float weights[GROUPS * N_LANES * N_ROWS];
    __shared__ int words[GROUPS * N_LANES * N_ROWS];
    const int width = seen.width, in_row = (width + 1) / 2, y = group() / in_row;
    const int x = group() % in_row * 2 + (y + turn) % 2, place = y * width + x;
    if (y >= seen.height || x >= width || costs[place] == infinity()) return;
    Best best{plane_at(planes, place), costs[place], 0.0f};
    const int news = news_of(seen, settings, others_moved, moved, turn, y, x, best.plane.disparity);
    if (news == 0) return;
    Window window{y, x, 0.0f, weights + threadIdx.x, words + threadIdx.x};
    take_window(seen, settings, window);
    if (best.cost < 0) best.cost = window_cost(seen, settings, window, best.plane, infinity());
    best.energy = best.cost + roughness(seen, settings, planes, window, best.plane);
    const float before = best.energy;
    uint32 state = seed * 0x9E3779B1u + uint32(y) * 0x85EBCA6Bu + uint32(x) * 0xC2B2AE35u;
    for (int number = 0; number < N_TRIALS; ++number) {
        if (!(news >> number & 1)) continue;
        Plane trial;
        if (number < N_NEIGHBOURS) {
            int column, row;
            neighbour(number, x, y, column, row);
            trial = plane_at(planes, row * width + column);
            trial.disparity = trial.at(float(x - column), float(y - row));
        } else if (number == N_NEIGHBOURS) {
            const int there = clamped(width - 1 - x + int(rintf(best.plane.disparity)), 0, width - 1);
            const Plane other = plane_at(others, y * width + there);
            const float squeeze = 1.0f / (1.0f - other.across);
            const float disparity = (other.disparity + other.across * float(width - 1 - x - there)) * squeeze;
            trial = Plane{disparity, -other.across * squeeze, other.down * squeeze};
        } else {
            const uint32 first = next_random(state), second = next_random(first);
            state = next_random(second);
            const float step = step_of(settings, number, turn), slope_step = step * SLOPE_SHARE;
            trial = Plane{best.plane.disparity + step * signed_unit(first),
                          best.plane.across + slope_step * signed_unit(second),
                          best.plane.down + slope_step * signed_unit(state)};
        }
        try_plane(seen, settings, planes, window, trial, best);
    }
    if (lane() == 0) {
        if (before - best.energy > NEWS * before) moved[place] = short(turn);
        costs[place] = best.cost;
        planes[3 * place] = best.plane.disparity;
        planes[3 * place + 1] = best.plane.across;
        planes[3 * place + 2] = best.plane.down;
    }
}
