#include "player/error_control.h"

#include <algorithm>
#include <cmath>
#include <utility>

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

// A splat of a candidate has a square for itself, and its samples lie a quarter of the square's side apart.
constexpr double samples_of_a_side = 3.5;

// To interpolate a pixel costs as much as so many layers of splats.
constexpr double layers_of_a_pixel = 4;

constexpr int most_candidates = 9;
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

double distance(const std::vector<vec3>& a, const std::vector<vec3>& b) {
  double sum = 0;
  for (std::size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    const dvec3 difference = dvec3(a[i]) - dvec3(b[i]);
    sum += glm::dot(difference, difference);
  }
  return std::sqrt(sum / std::max(3.0 * static_cast<double>(a.size()), 1.0));
}

// Whether wide samples would cost more than they save. `layers`: of splats in a mean pixel; 0: not counted.
bool overlap_little(double layers) { return layers > 0 && layers < layers_of_a_pixel; }

std::uint64_t times(std::uint64_t splats, double factor) {
  return static_cast<std::uint64_t>(std::clamp(static_cast<double>(splats) * factor, 1.0, 1e18));
}

}  // namespace

ErrorControl::ErrorControl(double max_error, const Search& search) : max_error_(max_error), search_(search) {
  next_ = Request{};
  next_->goal.expected_error = max_error * (search.grows ? first_grown : first_expected);
  next_->goal.max_splats = std::min(search.most_splats, most_first_splats);
  if (search.first_splats > 0) next_->goal = {0, std::min(search.first_splats, search.most_splats)};
}

int ErrorControl::spacing_of(std::uint64_t splats) const {
  const double side = std::sqrt(search_.pixels / std::max(static_cast<double>(splats), 1.0));
  if (overlap_little(layers_)) return 1;
  int spacing = 1;
  while (!search_.grows && 2 * spacing <= search_.widest_spacing && samples_of_a_side * 2 * spacing <= side)
    spacing *= 2;
  return spacing;
}

void ErrorControl::add(const Drawn& drawn) {
  ++pictures_;
  if (search_.pixels > 0) layers_ = drawn.fragments * std::pow(next_->sample_spacing, 2) / search_.pixels;
  if (drawn.allowed_splats < next_->goal.max_splats)
    search_.most_splats = std::min(search_.most_splats, std::max<std::uint64_t>(drawn.allowed_splats, 1));
  Picture picture{.samples = sample(drawn.image),
                  .goal = next_->goal,
                  .asked = next_->goal.max_splats,
                  .splats = drawn.splats,
                  .expected = drawn.expected_error,
                  .finest = drawn.finest,
                  .spacing = next_->sample_spacing};
  if (search_.grows) {
    grow(std::move(picture));
    return;
  }
  shows_candidate_ = step_ == Step::candidate;
  switch (step_) {
    case Step::chosen:
      next_.reset();
      return;
    case Step::coarser:
      add_coarser(std::move(picture));
      if (!file_error_) return;
      break;
    case Step::reference:
      reference_ = std::move(picture);
      break;
    case Step::candidate:
      // A goal of an error does not tell the number of splats.
      if (candidates_++ == 0) picture.asked = std::min(picture.asked, std::max<std::uint64_t>(picture.splats, 1));
      candidate_ = std::move(picture);
  }
  judge();
}

// Estimates the error of a picture from its distance to the one before, and asks for a finer one unless it will do.
void ErrorControl::grow(Picture picture) {
  picture.asked = std::max(pictures_ == 1 ? picture.splats : picture.asked, std::uint64_t{1});
  double factor = least_growth;
  if (candidate_) {
    const double by = static_cast<double>(picture.splats) / std::max(static_cast<double>(candidate_->splats), 1.0);
    const double share = std::pow(std::max(by, least_finer_to_estimate), -decay);
    const double apart = distance(candidate_->samples, picture.samples);
    picture.error = share * apart / std::sqrt(1 - share * share);
    factor = std::clamp(std::pow(picture.error / max_error_, 1 / decay), least_growth, most_change);
  }
  tried_.push_back({picture.splats, picture.error});
  const bool has_grown = candidate_ && static_cast<double>(picture.splats) >=
                                           least_finer_to_estimate * static_cast<double>(candidate_->splats);
  estimate_.error = picture.error;
  estimate_.reached = picture.finest || (has_grown && picture.error <= grown_enough * max_error_);
  learned_ = picture.expected / max_error_;
  const std::uint64_t asked = std::min(times(picture.asked, factor), search_.most_splats);
  if (estimate_.reached || asked <= picture.asked) {
    next_.reset();
    return;
  }
  // A picture that has hardly grown keeps the one before it, from which the next differs more.
  if (!candidate_ || has_grown) candidate_ = std::move(picture);
  next_ = Request{{0, asked}};
}

// Whether the reference's samples are too far apart for a candidate.
bool ErrorControl::has_wide_samples(const Picture& candidate) const {
  return reference_ && reference_->spacing > std::max(candidate.spacing / 2, 1);
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
    next_ = Request{{}, 2, reference_->spacing};
    return;
  }
  file_error_ =
      std::max(of_last_resolution * last_apart_, of_second_last * distance(picture.samples, coarser_samples_));
}

// Estimates the error of the candidate, and decides what comes next.
void ErrorControl::judge() {
  Picture& candidate = *candidate_;
  if (candidate.finest && candidate.spacing == 1 && !reference_) reference_ = candidate;
  const bool may_be_finer =
      reference_asked_ < search_.most_splats &&
      static_cast<double>(reference_asked_) < finer * jump * static_cast<double>(candidate.splats);
  if (!serves(candidate) && (may_be_finer || has_wide_samples(candidate))) {
    ask_reference();
    return;
  }
  const double apart = distance(candidate.samples, reference_->samples);
  if (!(reference_->finest ? estimate_by_all(apart) : estimate_by_finer(apart))) return;
  tried_.push_back({candidate.splats, candidate.error});
  estimate_.file_error = file_error_.value_or(0);
  const bool is_fine = candidate.ratio <= too_much;
  if (is_widening_) {
    is_fine ? widen(candidate) : choose(*fine_);
    return;
  }
  in_a_row_ = is_fine == last_is_fine_ ? in_a_row_ + 1 : 1;
  last_is_fine_ = is_fine;
  (is_fine ? fine_ : too_coarse_) = candidate;
  if ((candidate.ratio > enough && candidate.ratio <= too_much) || is_near_enough())
    fine_ ? widen(*fine_) : narrow(*too_coarse_);
  else
    ask_candidate(next_splats());
}

// Asks for the picture of a cut with wider samples, or ends with it.
void ErrorControl::widen(const Picture& fine) {
  fine_ = fine;
  if (2 * fine.spacing > search_.widest_spacing || overlap_little(layers_)) {
    choose(fine);
    return;
  }
  is_widening_ = true;
  step_ = Step::candidate;
  next_ = Request{fine.goal, 0, 2 * fine.spacing};
}

// Ends with a cut that is too coarse, or tries it with a sample in each pixel.
void ErrorControl::narrow(const Picture& too_coarse) {
  if (too_coarse.spacing == 1) {
    choose(too_coarse);
    return;
  }
  search_.widest_spacing = 1;
  ask_candidate(too_coarse.asked);
}

// Estimates the error from the distance to the picture of all points: it adds up with their own error, as the one says
// nothing about the other. Returns false if another picture is needed first.
bool ErrorControl::estimate_by_all(double apart) {
  if (!file_error_ && apart < 2 * max_error_) {
    step_ = Step::coarser;
    next_ = Request{{}, 1, reference_->spacing};
    return false;
  }
  const double file = file_error_.value_or(0);
  const double left = std::sqrt(std::max(0.0, max_error_ * max_error_ - file * file));
  candidate_->error = std::hypot(apart, file);
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
    candidate_->error = std::hypot(apart, reference_->error);
  } else {  // no finer reference is possible
    ask_candidate(times(reference_->splats, 1 / finer));
    if (candidate_->asked != next_->goal.max_splats) return false;
    candidate_->error = apart;
  }
  candidate_->ratio = candidate_->error / max_error_;
  return true;
}

void ErrorControl::ask_candidate(std::uint64_t splats) {
  step_ = Step::candidate;
  const std::uint64_t asked = std::clamp<std::uint64_t>(splats, 1, search_.most_splats);
  next_ = Request{{0, asked}, 0, spacing_of(asked)};
}

// Asks for a finer one each time, as the next finer cut may have several times as many splats.
void ErrorControl::ask_reference() {
  const double before = static_cast<double>(reference_asked_), wanted = finer * static_cast<double>(candidate_->splats);
  const double more = has_wide_samples(*candidate_) ? std::max(before, wanted) : jump * wanted;
  reference_asked_ = std::min(times(1, before >= wanted ? more : wanted), search_.most_splats);
  step_ = Step::reference;
  next_ = Request{{0, reference_asked_}, 0, std::max(candidate_->spacing / 2, 1)};
}

// Whether another candidate would not be better.
bool ErrorControl::is_near_enough() const {
  if (candidates_ >= most_candidates) return true;
  if (!fine_) return too_coarse_->finest || too_coarse_->asked >= search_.most_splats;
  if (!too_coarse_) return fine_->splats > fine_->asked || fine_->asked <= 1;  // the coarsest that the view has
  return static_cast<double>(fine_->asked) < near_each_other * static_cast<double>(too_coarse_->asked) ||
         static_cast<double>(fine_->splats) < near_each_other * static_cast<double>(too_coarse_->splats);
}

std::uint64_t ErrorControl::next_splats() const {
  if (!fine_ || !too_coarse_) {
    const Picture& from = fine_ ? *fine_ : *too_coarse_;
    const double factor = std::pow(std::max(from.ratio, 1e-9), 1 / decay);
    const std::uint64_t asked = fine_ ? std::min(from.asked, from.splats) : from.asked;
    return times(asked, std::clamp(factor, 1 / most_change, most_change));
  }
  // Between two, on a straight line of logarithms, not too near to either. In the middle, if the line has led to the
  // same side again and again: there the error falls unlike a power.
  const double low = std::log(static_cast<double>(too_coarse_->asked)),
               high = std::log(static_cast<double>(fine_->asked));
  const double from = std::log(too_coarse_->ratio), to = std::log(std::max(fine_->ratio, 1e-3));
  const double share = in_a_row_ > most_in_a_row ? 0.5 : std::clamp(from / (from - to), 0.15, 0.85);
  return static_cast<std::uint64_t>(std::exp(low + share * (high - low)));
}

// Ends with a candidate, which is drawn again unless it is the last picture.
void ErrorControl::choose(const Picture& chosen) {
  estimate_.error = chosen.error;
  estimate_.reached = chosen.ratio <= too_much;
  learned_ = chosen.expected / max_error_;
  step_ = Step::chosen;
  next_ = Request{chosen.goal, 0, chosen.spacing};
  if (shows_candidate_ && chosen.asked == candidate_->asked && chosen.spacing == candidate_->spacing) next_.reset();
}

}  // namespace splatvol
