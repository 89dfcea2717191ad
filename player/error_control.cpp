#include "player/error_control.h"

#include <algorithm>
#include <cmath>
#include <tuple>
#include <utility>

#include "base/hypotenuse.h"

namespace splatvol {
namespace {

// The error of a cut of n splats goes by n^-decay, on most scenes.
constexpr double decay = 0.45;

// The reference has this many times the splats of a candidate. A candidate that comes near to this keeps the reference.
constexpr double finer = 8, least_finer = 5;

// A reference of fewer times the splats tells little by itself.
constexpr double least_finer_to_estimate = 3;

// A file of fewer points than this many times the reference is drawn as a whole.
constexpr double jump = 8;  // the most by which resolutions differ

// The first candidate has no more splats: it may be much too fine.
constexpr std::uint64_t most_first_splats = std::uint64_t{1} << 15;
constexpr double first_expected = 2;  // its expected error, of the wanted

// The error of all points: at least so much of their distance to the resolution before, and of the distance from there
// to the resolution before that.
constexpr double of_last_resolution = 0.45, of_second_last = 0.25;

// Near the file's own error a cut adds this share of the wanted error: more splats would not help much. If all
// points have more than twice the wanted error, the cut adds the whole wanted error.
constexpr double least_share = 0.65, share_of_file_error = 0.5;

// A candidate this near to the wanted error is the one. Two are near each other if their splats differ by less.
constexpr double enough = 0.93, too_much = 1.04;
constexpr double near_each_other = 1.12;

// Growing pictures begin with one of this expected error, of the wanted. Each tells the error of the next less exactly
// than a finer reference would.
constexpr double first_grown = 4, grown_enough = 0.8;
constexpr double least_growth = 4;

// A candidate is worth its picture if it is less work than the best by this.
constexpr double worth = 0.9;

// Wide samples have stalled if more splats make the error fall by less than this share of what they do on most scenes.
constexpr double least_fall = 0.33, least_more = 2;

// Samples were too far apart if narrower ones have at most this share of the error.
constexpr double least_gain = 0.85;

// Narrower samples are not tried if all points have so much of the wanted error besides that of samples.
constexpr double far_too_much = 2;

// Fewer splats with narrower samples are tried if they are not fewer than this share.
constexpr double least_probed = 1.0 / 6;

// Outlines of cells show steps of samples farther apart than this. Their error is small only where there are none.
constexpr int widest_of_outlines = 2;
constexpr double most_error_of_steps = 0.001;

// Growing pictures that are measured grow at least by this.
constexpr double least_measured_growth = 1.3;

constexpr int most_candidates = 9;  // of a sample spacing
constexpr int most_in_a_row = 2;
constexpr double most_change = 16;  // of splats, from one candidate to the next

constexpr std::size_t most_samples = std::size_t{1} << 18;
constexpr int tile = 16;

// Takes all pixels of a small picture, and else every k-th tile of 16 x 16. Rows of tiles are shifted, so that columns
// are sampled too.
std::vector<vec3> sample(const Image& image) {
  const std::size_t pixels = image.pixels.size();
  const int every = static_cast<int>((pixels + most_samples - 1) / most_samples);
  std::vector<vec3> samples;
  samples.reserve(std::min(pixels, 2 * most_samples));
  for (int y = 0; y < image.height; ++y)
    for (int x = 0; x < image.width; ++x)
      if (every <= 1 || (x / tile + 2 * (y / tile)) % every == 0) samples.emplace_back(image.at(x, y));
  return samples;
}

// Squared distances of samples, of a mean channel.
struct Distances {
  double mean = 0;
  double doubt = 0;  // the standard error of the mean, as of samples of a picture
};

Distances distances(const std::vector<vec3>& a, const std::vector<vec3>& b) {
  double sum = 0, of_squares = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    const dvec3 difference = dvec3(a[i]) - dvec3(b[i]);
    const double square = glm::dot(difference, difference) / 3;
    sum += square;
    of_squares += square * square;
  }
  const double count = std::max(static_cast<double>(a.size()), 1.0), mean = sum / count;
  return {mean, std::sqrt(std::max(of_squares / count - mean * mean, 0.0) / count)};
}

double distance(const std::vector<vec3>& a, const std::vector<vec3>& b) { return std::sqrt(distances(a, b).mean); }

double error_of_all(double last_apart, double second_last_apart) {
  return std::max(of_last_resolution * last_apart, of_second_last * second_last_apart);
}

// The error of a picture that exact rays hardly exceed. They miss some of an error that lies in few pixels, as at
// outlines, and so their doubt counts.
double surely(const std::vector<vec3>& samples, const std::vector<vec3>& rays) {
  const Distances squares = distances(samples, rays);
  return std::sqrt(squares.mean + squares.doubt);
}

// Everything so many resolutions before the finest.
Detail coarser_detail(std::size_t resolutions, std::size_t coarser) {
  return {.resolution = std::max(resolutions, coarser + 1) - 1 - coarser};
}

std::uint64_t times(std::uint64_t splats, double factor) {
  return static_cast<std::uint64_t>(std::clamp(static_cast<double>(splats) * factor, 1.0, 1e18));
}

}  // namespace

ErrorControl::ErrorControl(double max_error, Search search) : max_error_(max_error), search_(std::move(search)) {
  if (search_.grows) search_.widest_spacing = search_.finest_spacing;
  if (search_.rays) rays_ = search_.rays->colors();
  bracket_.spacing = search_.widest_spacing;
  may_narrow_ = bracket_.spacing > search_.finest_spacing;
  // Only rays tell the error of wide samples of cells.
  if (search_.cells && (search_.rays || search_.finest_spacing == 1))
    exact_spacing_ = search_.rays ? search_.widest_spacing : 1;
  next_ = Request{.sample_spacing = bracket_.spacing};
  next_->goal.expected_error = max_error * (search_.grows ? first_grown : first_expected);
  next_->goal.max_splats = std::min(search_.most_splats, most_first_splats);
  if (search_.first_splats > 0) next_->goal = {0, std::min(search_.first_splats, search_.most_splats)};
}

std::optional<Recipe> ErrorControl::next(const Choices& /*choices*/) {
  if (!next_) return {};
  if (next_->exact) return Recipe::of_cells(next_->sample_spacing);
  if (next_->coarser > 0) return Recipe{coarser_detail(search_.resolutions, next_->coarser), next_->sample_spacing};
  return Recipe{Detail{.goal = next_->goal}, next_->sample_spacing};
}

void ErrorControl::add(const Outcome& drawn, const Choices& /*choices*/) {
  ++pictures_;
  if (step_ == Step::chosen) {
    next_.reset();
    return;
  }
  // Memory may have no room for more.
  if (const std::uint64_t allowed = drawn.recipe.most_splats(); allowed > 0 && allowed < next_->goal.max_splats)
    search_.most_splats = std::min(search_.most_splats, allowed);
  const int spacing = next_->sample_spacing;
  Picture picture{.samples = search_.rays ? at_rays(*drawn.picture, *search_.rays) : sample(*drawn.picture),
                  .goal = next_->goal,
                  .asked = next_->goal.max_splats,
                  .splats = drawn.splats,
                  .expected = drawn.expected_error.value_or(0),
                  .finest = drawn.finest,
                  .exact = next_->exact,
                  .spacing = spacing};
  if (picture.exact) {
    picture.work = work_of_exact(spacing);
  } else {
    const double splats = std::max(static_cast<double>(drawn.splats), 1.0);
    layers_ = search_.pixels > 0 ? layers_of_one_splat(drawn.fragments, splats, samples_of(spacing)) : 0;
    picture.work = work_of(splats, spacing);
  }
  if (search_.grows) {
    grow(std::move(picture));
    return;
  }
  shows_candidate_ = step_ == Step::candidate;
  switch (step_) {
    case Step::coarser:
      add_coarser(std::move(picture));
      if (!file_error_) return;
      break;
    case Step::reference:
      reference_ = std::move(picture);
      break;
    default:
      // A goal of an error does not tell the number of splats.
      if (pictures_ == 1) picture.asked = std::min(picture.asked, std::max<std::uint64_t>(picture.splats, 1));
      candidate_ = std::move(picture);
  }
  judge();
}

// Asks for a finer picture unless this one will do. Without rays, its distance to the one before tells its error.
void ErrorControl::grow(Picture picture) {
  picture.asked = std::max(pictures_ == 1 ? picture.splats : picture.asked, std::uint64_t{1});
  const double by =
      candidate_ ? static_cast<double>(picture.splats) / std::max(static_cast<double>(candidate_->splats), 1.0) : 0;
  const double least = search_.rays ? least_measured_growth : least_growth;
  const bool has_grown = by >= least_finer_to_estimate;
  bool is_fine = false;
  if (search_.rays) {
    picture.error = distance(picture.samples, rays_);
    is_fine = surely(picture.samples, rays_) <= max_error_;
  } else if (candidate_) {
    const double share = std::pow(std::max(by, least_finer_to_estimate), -decay);
    picture.error = share * distance(candidate_->samples, picture.samples) / std::sqrt(1 - share * share);
    is_fine = has_grown && picture.error <= grown_enough * max_error_;
  }
  const double factor = std::clamp(std::pow(picture.error / max_error_, 1 / decay), least, most_change);
  tried_.push_back({picture.splats, picture.spacing, picture.error, picture.work});
  estimate_ = {.error = picture.error, .reached = is_fine || picture.finest, .measured = search_.rays.has_value()};
  learned_ = picture.expected / max_error_;
  const std::uint64_t asked = std::min(times(picture.asked, factor), search_.most_splats);
  if (estimate_.reached || asked <= picture.asked) {
    next_.reset();
    return;
  }
  // A picture that has hardly grown keeps the one before it, from which the next differs more.
  if (!candidate_ || has_grown) candidate_ = std::move(picture);
  next_ = Request{.goal = {0, asked}, .sample_spacing = bracket_.spacing};
}

// Decides what comes after a candidate, its reference or what tells the reference's error.
void ErrorControl::judge() {
  Picture& candidate = *candidate_;
  if (!estimate(candidate)) return;
  tried_.push_back({candidate.splats, candidate.spacing, candidate.error, candidate.work});
  const bool is_fine = candidate.ratio <= too_much;
  if (is_fine && (!best_ || candidate.work < best_->work)) best_ = candidate;
  const bool is_useless = is_probing_ && bracket_.candidates == 0 && !is_fine;
  if (!candidate.exact) add_to_bracket(candidate);
  if (is_useless) {
    end();
    return;
  }
  if (wide_ && (candidate.exact ? rules_out_narrower(candidate) : is_no_better(candidate))) widen_again();
  if (!candidate.exact) wide_.reset();
  go_on();
}

void ErrorControl::add_to_bracket(const Picture& candidate) {
  const bool is_fine = candidate.ratio <= too_much;
  bracket_.in_a_row = is_fine == bracket_.last_is_fine ? bracket_.in_a_row + 1 : 1;
  bracket_.last_is_fine = is_fine;
  ++bracket_.candidates;
  if (!is_fine) bracket_.coarser = std::exchange(bracket_.too_coarse, {});
  (is_fine ? bracket_.fine : bracket_.too_coarse) = candidate;
}

// Asks for the next candidate, or ends.
void ErrorControl::go_on() {
  const auto end_of_spacing = [this] { bracket_.fine || !may_narrow_ || is_probing_ ? end() : narrow(); };
  if ((bracket_.fine && bracket_.fine->ratio > enough) || is_near_enough() || has_stalled()) {
    end_of_spacing();
    return;
  }
  const std::uint64_t splats = std::clamp<std::uint64_t>(next_splats(), 1, search_.most_splats);
  const double work = work_of(static_cast<double>(splats), bracket_.spacing);
  if (ask_cells(work)) return;
  best_&& work > worth * best_->work ? end_of_spacing() : ask_candidate(splats, bracket_.spacing);
}

// Whether more splats hardly help, and something else may.
bool ErrorControl::has_stalled() const {
  if (bracket_.fine || !bracket_.coarser || !(may_narrow_ || exact_spacing_ > 0)) return false;
  const Picture &from = *bracket_.coarser, &to = *bracket_.too_coarse;
  const double more = static_cast<double>(to.splats) / std::max(static_cast<double>(from.splats), 1.0);
  return more >= least_more && to.ratio > from.ratio * std::pow(more, -least_fall * decay);
}

// Goes on with samples half as far apart.
void ErrorControl::narrow() {
  const std::uint64_t from = bracket_.too_coarse ? bracket_.too_coarse->asked : bracket_.first_splats;
  // Without rays, errors of samples are measured against narrower ones, and are not comparable.
  wide_ = bracket_.too_coarse && search_.rays ? std::optional(bracket_) : std::nullopt;
  bracket_ = {.spacing = bracket_.spacing / 2, .first_splats = from};
  may_narrow_ = bracket_.spacing > search_.finest_spacing;
  go_on();
}

// Whether all points have far too much error besides that of wide samples. Cells have only that, and about as much.
bool ErrorControl::rules_out_narrower(const Picture& cells) const {
  const Picture& wide = *wide_->too_coarse;
  return wide.finest && wide.spacing == cells.spacing &&
         wide.error * wide.error - cells.error * cells.error > std::pow(far_too_much * max_error_, 2);
}

// Whether the first candidate of narrower samples has hardly less error than the last of wide ones.
bool ErrorControl::is_no_better(const Picture& narrow) const {
  return narrow.ratio > too_much && narrow.ratio > least_gain * wide_->too_coarse->ratio;
}

// Goes back to wide samples, as narrower ones do not help either.
void ErrorControl::widen_again() {
  bracket_ = *wide_;
  may_narrow_ = false;
  wide_.reset();
}

// Asks for the cells, unless they are as much work as the best candidate, or more work than another picture.
bool ErrorControl::ask_cells(double other_work) {
  if (exact_spacing_ == 0) return false;
  const int spacing = exact_spacing_;
  const double work = work_of_exact(spacing);
  if (work > other_work || (best_ && work > worth * best_->work)) return false;
  exact_spacing_ = spacing > search_.finest_spacing ? spacing / 2 : 0;
  if (spacing == 1) {  // its error is known
    best_ = Picture{.exact = true, .work = work};
    return false;
  }
  step_ = Step::candidate;
  next_ = Request{.exact = true, .sample_spacing = spacing};
  return true;
}

// Asks for the best candidate's splats with wider samples, if narrower ones came after them, or for as many splats with
// narrower samples as are less work. Returns false if neither makes sense.
bool ErrorControl::probe() {
  if (is_probing_ || !best_ || best_->exact || layers_ <= 0) return false;
  is_probing_ = true;
  const auto splats = static_cast<double>(best_->splats);
  const auto try_spacing = [&](int spacing, double fewer) {
    bracket_ = {.spacing = spacing};
    ask_candidate(times(std::min(best_->asked, best_->splats), fewer), spacing);
    return true;
  };
  const int wider = 2 * best_->spacing;
  if (wider <= search_.widest_spacing && work_of(splats, wider) <= worth * best_->work) return try_spacing(wider, 1);
  int best_spacing = 0;
  double most = least_probed;
  for (const int spacing : {best_->spacing / 2, search_.finest_spacing}) {
    if (spacing < search_.finest_spacing || spacing == best_->spacing) continue;
    double share = 1;
    while (share > most && work_of(share * splats, spacing) > worth * best_->work) share *= 0.95;
    if (share > most) best_spacing = spacing, most = share;
  }
  return best_spacing > 0 && try_spacing(best_spacing, most);
}

// Ends the search, unless another kind of picture may be less work.
void ErrorControl::end() {
  if (ask_cells(std::numeric_limits<double>::infinity()) || probe()) return;
  choose(best_ ? *best_ : *bracket_.too_coarse);
}

// Estimates the error of a candidate. Returns false if another picture is needed first.
bool ErrorControl::estimate(Picture& candidate) {
  if (search_.rays) {
    candidate.error = distance(candidate.samples, rays_);
    const bool may_show_steps = candidate.exact && candidate.spacing > widest_of_outlines;
    const double wanted = may_show_steps ? std::min(max_error_, most_error_of_steps) : max_error_;
    candidate.ratio = surely(candidate.samples, rays_) / wanted;
    if (candidate.finest && candidate.spacing == search_.finest_spacing) file_error_ = candidate.error;
    return true;
  }
  if (candidate.finest && candidate.spacing == search_.finest_spacing && !reference_) reference_ = candidate;
  const bool may_be_finer =
      reference_asked_ < search_.most_splats &&
      static_cast<double>(reference_asked_) < finer * jump * static_cast<double>(candidate.splats);
  if (!serves(candidate) && (may_be_finer || has_wide_samples(candidate))) {
    ask_reference();
    return false;
  }
  const double apart = distance(candidate.samples, reference_->samples);
  return reference_->finest ? estimate_by_all(apart) : estimate_by_finer(apart);
}

// Whether the reference's samples are too far apart for a candidate.
bool ErrorControl::has_wide_samples(const Picture& candidate) const {
  return reference_ && reference_->spacing > finer_spacing(candidate);
}

// Whether the reference is finer than a candidate by enough.
bool ErrorControl::serves(const Picture& candidate) const {
  return reference_ &&
         (reference_->finest ||
          static_cast<double>(reference_->splats) >= least_finer * static_cast<double>(candidate.splats)) &&
         !has_wide_samples(candidate);
}

// Estimates the error of all points from the two resolutions before. Their pictures tell more than one: where a
// function is dense or narrow, the last step may be small by chance.
void ErrorControl::add_coarser(Picture picture) {
  if (coarser_samples_.empty()) {
    last_apart_ = distance(picture.samples, reference_->samples);
    coarser_samples_ = std::move(picture.samples);
    next_ = Request{.coarser = 2, .sample_spacing = reference_->spacing};
    return;
  }
  file_error_ = error_of_all(last_apart_, distance(picture.samples, coarser_samples_));
}

// Estimates the error from the distance to the picture of all points: it adds up with their own error, as the one says
// nothing about the other. Returns false if another picture is needed first.
bool ErrorControl::estimate_by_all(double apart) {
  if (!file_error_ && apart < 2 * max_error_) {
    step_ = Step::coarser;
    next_ = Request{.coarser = 1, .sample_spacing = reference_->spacing};
    return false;
  }
  const double file = file_error_.value_or(0);
  const double left = std::sqrt(std::max(0.0, max_error_ * max_error_ - file * file));
  candidate_->error = hypotenuse(apart, file);
  const double least = std::clamp(share_of_file_error * file, least_share * max_error_, max_error_);
  candidate_->ratio = apart / std::max(left, least);
  return true;
}

// Estimates the error from the distance to a finer picture, which has a share of it too. Returns false if another
// picture is needed first.
bool ErrorControl::estimate_by_finer(double apart) {
  const double by = static_cast<double>(reference_->splats) / std::max(static_cast<double>(candidate_->splats), 1.0);
  if (by >= least_finer_to_estimate) {
    const double share = std::pow(by, -decay);
    candidate_->error = apart / std::sqrt(1 - share * share);
    reference_->error = share * candidate_->error;
  } else if (reference_->error > 0) {
    candidate_->error = hypotenuse(apart, reference_->error);
  } else {  // no finer reference is possible
    ask_candidate(times(reference_->splats, 1 / finer), candidate_->spacing);
    if (candidate_->asked != next_->goal.max_splats) return false;
    candidate_->error = apart;
  }
  candidate_->ratio = candidate_->error / max_error_;
  return true;
}

void ErrorControl::ask_candidate(std::uint64_t splats, int spacing) {
  step_ = Step::candidate;
  const std::uint64_t asked = std::clamp<std::uint64_t>(splats, 1, search_.most_splats);
  next_ = Request{.goal = {0, asked}, .sample_spacing = spacing};
}

// Asks for a finer one each time, as the next finer cut may have several times as many splats.
void ErrorControl::ask_reference() {
  const double before = static_cast<double>(reference_asked_), wanted = finer * static_cast<double>(candidate_->splats);
  const double more = has_wide_samples(*candidate_) ? std::max(before, wanted) : jump * wanted;
  reference_asked_ = std::min(times(1, before >= wanted ? more : wanted), search_.most_splats);
  step_ = Step::reference;
  next_ = Request{.goal = {0, reference_asked_}, .sample_spacing = finer_spacing(*candidate_)};
}

// Whether another candidate would not be better.
bool ErrorControl::is_near_enough() const {
  const auto& [fine, too_coarse] = std::tie(bracket_.fine, bracket_.too_coarse);
  if (bracket_.candidates >= most_candidates) return true;
  if (!fine) return too_coarse && (too_coarse->finest || too_coarse->asked >= search_.most_splats);
  if (!too_coarse) return fine->splats > fine->asked || fine->asked <= 1;  // the coarsest that the view has
  return static_cast<double>(fine->asked) < near_each_other * static_cast<double>(too_coarse->asked) ||
         static_cast<double>(fine->splats) < near_each_other * static_cast<double>(too_coarse->splats);
}

std::uint64_t ErrorControl::next_splats() const {
  const auto& [fine, too_coarse] = std::tie(bracket_.fine, bracket_.too_coarse);
  if (!fine && !too_coarse) return bracket_.first_splats;
  if (!fine || !too_coarse) {
    const Picture& from = fine ? *fine : *too_coarse;
    const double least = fine || bracket_.in_a_row < most_in_a_row ? 1 / most_change : least_more;
    const double factor = std::pow(std::max(from.ratio, 1e-9), 1 / decay);
    const std::uint64_t asked = fine ? std::min(from.asked, from.splats) : from.asked;
    return times(asked, std::clamp(factor, least, most_change));
  }
  // Between two, on a straight line of logarithms, not too near to either. In the middle, if the line has led to the
  // same side again and again: there the error falls unlike a power.
  const double low = std::log(static_cast<double>(too_coarse->asked)),
               high = std::log(static_cast<double>(fine->asked));
  const double from = std::log(too_coarse->ratio), to = std::log(std::max(fine->ratio, 1e-3));
  const double share = bracket_.in_a_row > most_in_a_row ? 0.5 : std::clamp(from / (from - to), 0.15, 0.85);
  return static_cast<std::uint64_t>(std::exp(low + share * (high - low)));
}

// Ends with a candidate, which is drawn again unless it is the last picture.
void ErrorControl::choose(const Picture& chosen) {
  estimate_ = {.error = chosen.error,
               .file_error = file_error_.value_or(0),
               .reached = chosen.ratio <= too_much,
               .measured = search_.rays.has_value()};
  if (!chosen.exact) learned_ = chosen.expected / max_error_;
  const bool is_shown = shows_candidate_ && chosen.asked == candidate_->asked && chosen.exact == candidate_->exact &&
                        chosen.spacing == candidate_->spacing;
  step_ = Step::chosen;
  next_ = Request{chosen.goal, 0, chosen.exact, chosen.spacing};
  if (is_shown) next_.reset();
}

// The estimated work of so many splats, from the layers of the last picture.
double ErrorControl::work_of(double splats, int spacing) const {
  const double fragments = fragments_of_splats(layers_, splats, samples_of(spacing));
  return work_of_splats(splats, fragments, search_.pixels, spacing);
}

double ErrorControl::work_of_exact(int spacing) const { return work_of_cells(*search_.cells, search_.pixels, spacing); }

AllPoints::AllPoints(std::size_t resolutions, std::optional<Rays> rays)
    : resolutions_(resolutions), rays_(std::move(rays)), coarser_(rays_ || resolutions <= 2 ? 0 : 2) {}

std::optional<Recipe> AllPoints::next(const Choices& /*choices*/) {
  if (coarser_ < 0) return {};
  if (coarser_ == 0) return Recipe{Detail{.tolerance_percent = 0}};
  return Recipe{coarser_detail(resolutions_, static_cast<std::size_t>(coarser_))};
}

void AllPoints::add(const Outcome& outcome, const Choices& /*choices*/) {
  ++pictures_;
  samples_.push_back(rays_ ? at_rays(*outcome.picture, *rays_) : sample(*outcome.picture));
  if (coarser_-- > 0) return;
  if (rays_)
    estimate_ = {.error = distance(samples_[0], rays_->colors()), .reached = true, .measured = true};
  else if (samples_.size() > 2)
    estimate_ = {.error = error_of_all(distance(samples_[2], samples_[1]), distance(samples_[1], samples_[0])),
                 .reached = true};
  if (estimate_) estimate_->file_error = estimate_->error;
}

}  // namespace splatvol
