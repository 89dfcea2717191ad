#include "player/error_control.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace splatvol {
namespace {

constexpr std::size_t resolutions = 10;

// A view whose pictures have known errors. Each step of splats adds a field of noise, so that the error of n splats
// goes by n^-decay, down to that of all points.
class KnownView {
 public:
  struct Options {
    double scale = 1;  // the error of one splat
    double decay = 0.45;
    double file_error = 0;
    double last_step = 2, second_last_step = 3;  // from one resolution to the next, of file_error
    double expects = 1;                          // expected error over the true one
    std::uint64_t coarsest = 100, all = 1 << 20;
    double step = 1.2;  // from one cut to the next finer one
    int width = 96, height = 64;
    double sampling_error = 0;  // of samples 2 pixels apart; four times as large with twice the pixels
    double layers = 100;        // of splats in a pixel
  };

  explicit KnownView(const Options& options) : options_(options) {
    for (auto n = static_cast<double>(options.coarsest); n < static_cast<double>(options.all); n *= options.step)
      cuts_.push_back(n);
    cuts_.push_back(static_cast<double>(options.all));
  }

  [[nodiscard]] double error_of(std::size_t cut) const { return std::hypot(own_error(cut), options_.file_error); }

  [[nodiscard]] std::size_t cut_of(const ErrorGoal& goal) const {
    std::size_t cut = 0;
    while (cut + 1 < cuts_.size() && cuts_[cut + 1] <= static_cast<double>(goal.max_splats) &&
           !(options_.expects * error_of(cut) <= goal.expected_error))
      ++cut;
    return cut;
  }

  void draw(ErrorControl& control) {
    const Recipe recipe = *control.next({});
    const std::size_t coarser = recipe.splats->resolution ? resolutions - 1 - *recipe.splats->resolution : 0;
    const std::size_t cut = coarser > 0 ? cuts_.size() - 1 : cut_of(*recipe.splats->goal);
    Image image = picture(cut, coarser);
    const double spacing = recipe.sample_spacing;
    add(image, 1000, options_.sampling_error * (spacing * spacing - 1) / 3);
    control.add({.recipe = recipe,
                 .splats = static_cast<std::uint64_t>(cuts_[cut]),
                 .expected_error = options_.expects * error_of(cut),
                 .finest = coarser == 0 && cut + 1 == cuts_.size(),
                 .fragments = options_.layers * options_.width * options_.height / (spacing * spacing),
                 .picture = &image},
                {});
    if (coarser == 0) last_ = cut, spacing_ = recipe.sample_spacing;
    drawn_ += cuts_[cut];
  }

  // Runs a control to its end. Returns the last cut.
  std::size_t run(ErrorControl& control) {
    while (control.next({}) && control.pictures() < 50) draw(control);
    EXPECT_FALSE(control.next({}));
    return last_;
  }

  // The fewest splats of an error; all if even they have more.
  [[nodiscard]] double fewest(double error) const {
    for (std::size_t cut = 0; cut < cuts_.size(); ++cut)
      if (error_of(cut) <= error) return cuts_[cut];
    return cuts_.back();
  }

  [[nodiscard]] double splats(std::size_t cut) const { return cuts_[cut]; }
  [[nodiscard]] double drawn() const { return drawn_; }
  [[nodiscard]] std::size_t last() const { return last_; }
  [[nodiscard]] int spacing() const { return spacing_; }  // of the last picture's samples

 private:
  [[nodiscard]] double own_error(std::size_t cut) const {
    return cut + 1 == cuts_.size() ? 0 : options_.scale * std::pow(cuts_[cut], -options_.decay);
  }

  // Adds the noise of all finer cuts to a grey. Coarser resolutions than all points are known shares of the file's
  // error away from the next finer one.
  [[nodiscard]] Image picture(std::size_t cut, std::size_t coarser) const {
    Image image{options_.width, options_.height, {}};
    image.pixels.assign(static_cast<std::size_t>(image.width * image.height), vec4(0.5F, 0.5F, 0.5F, 1));
    for (std::size_t finer = cut + 1; finer < cuts_.size(); ++finer)
      add(image, finer, std::sqrt(std::pow(own_error(finer - 1), 2) - std::pow(own_error(finer), 2)));
    if (coarser > 0) add(image, cuts_.size(), options_.last_step * options_.file_error);
    if (coarser > 1) add(image, cuts_.size() + 1, options_.second_last_step * options_.file_error);
    return image;
  }

  static void add(Image& image, std::size_t seed, double deviation) {
    std::minstd_rand random(static_cast<unsigned>(seed) + 1);
    std::uniform_real_distribution<float> noise(-1, 1);
    const auto scale = static_cast<float>(std::sqrt(3.0) * deviation);
    for (vec4& pixel : image.pixels)
      for (int c = 0; c < 3; ++c) pixel[c] += scale * noise(random);
  }

  Options options_;
  std::vector<double> cuts_;  // splats
  std::size_t last_ = 0;
  int spacing_ = 0;
  double drawn_ = 0;
};

TEST(ErrorControl, FindsTheSplatsOfAnErrorWhateverTheModelExpects) {
  for (const double expects : {0.1, 0.3, 1.0, 3.0, 10.0})
    for (const double decay : {0.35, 0.45, 0.6})
      for (const double error : {0.02, 0.005, 0.0025}) {
        KnownView view({.decay = decay, .expects = expects});
        ErrorControl control(error, {.resolutions = resolutions});
        const std::size_t cut = view.run(control);
        const auto label = ::testing::Message() << expects << " expected, decay " << decay << ", error " << error;
        EXPECT_LE(view.error_of(cut), 1.25 * error) << label;
        EXPECT_LE(view.splats(cut), 1.5 * view.fewest(error)) << label;
        EXPECT_NEAR(control.estimate().error, view.error_of(cut), 0.25 * error) << label;
        EXPECT_TRUE(control.estimate().reached) << label;
        EXPECT_LE(control.pictures(), 15) << label;
        EXPECT_LE(view.drawn(), 100 * view.splats(cut) + 2e6) << label;
      }
}

// Samples are as wide as the error allows, and the error counts theirs.
TEST(ErrorControl, SamplesAreAsWideAsTheErrorAllows) {
  constexpr double error = 0.02;
  const auto spacing_with = [&](double sampling_error, double layers, int widest, double scale = 1, int finest = 1) {
    KnownView view({.scale = scale, .width = 480, .height = 320, .sampling_error = sampling_error, .layers = layers});
    ErrorControl control(error, {.finest_spacing = finest, .widest_spacing = widest, .pixels = 480 * 320});
    const std::size_t cut = view.run(control);
    const double of_samples = sampling_error * (std::pow(view.spacing(), 2) - 1) / 3;
    EXPECT_LE(std::hypot(view.error_of(cut), of_samples), 1.25 * error) << sampling_error;
    EXPECT_LE(view.splats(cut), 3 * view.fewest(error)) << sampling_error;
    EXPECT_TRUE(control.estimate().reached);
    return view.spacing();
  };
  EXPECT_EQ(spacing_with(0, 100, 4), 4);
  EXPECT_EQ(spacing_with(0, 100, 8), 8);
  EXPECT_EQ(spacing_with(0, 100, 1), 1);
  EXPECT_EQ(spacing_with(0.006, 100, 4), 2) << "4 pixels apart they have an error of .02";
  EXPECT_EQ(spacing_with(0.1, 100, 4), 1);
  EXPECT_EQ(spacing_with(0, 1, 4, 0.05), 1) << "where few splats lie, pixels cost more than splats";
  EXPECT_EQ(spacing_with(0, 1, 3, 0.05, 3), 3) << "they are asked for";
}

// A narrow function: wide samples of cells show that those of splats are not what is wrong.
TEST(ErrorControl, SplatsThatCannotHaveTheErrorAreDrawnOnce) {
  Image exact{96, 64, {}};
  exact.pixels.assign(96 * 64, vec4(0.5F, 0.5F, 0.5F, 1));
  const auto off_by = [&](float error) {
    Image image = exact;
    for (vec4& pixel : image.pixels) pixel.r += error * std::sqrt(3.0F);
    return image;
  };
  ErrorControl control(0.005, {.widest_spacing = 4,
                               .pixels = 96 * 64,
                               .rays = Rays{.image = exact},
                               .cells = CellCounts{.tetrahedra = 1000, .segments = 1e5}});
  std::vector<int> splats, cells;  // the spacings
  while (control.next({}) && control.pictures() < 20) {
    const bool is_exact = control.next({})->is_exact();
    const int spacing = control.next({})->sample_spacing;
    (is_exact ? cells : splats).push_back(spacing);
    const Image image = off_by(!is_exact ? 0.05F : spacing > 1 ? 0.01F : 0.0F);
    control.add({.recipe = *control.next({}), .splats = 1000, .finest = true, .fragments = 1e4, .picture = &image}, {});
  }
  EXPECT_EQ(splats, std::vector<int>{4});
  EXPECT_EQ(cells, (std::vector<int>{4, 2, 1}));
  EXPECT_EQ(control.estimate().error, 0);
}

TEST(ErrorControl, StaysNearTheErrorWhereCutsAreFarApart) {
  for (const double error : {0.02, 0.01, 0.005}) {
    KnownView view({.step = 6});
    ErrorControl control(error, {.resolutions = resolutions});
    const std::size_t cut = view.run(control);
    EXPECT_LE(view.error_of(cut), 1.25 * error);
    EXPECT_LE(view.splats(cut), 1.5 * view.fewest(error));
  }
}

TEST(ErrorControl, CountsTheErrorOfAllPoints) {
  for (const double file_error : {0.3, 0.6, 0.9}) {
    KnownView view({.file_error = 0.01 * file_error, .all = 100000});
    ErrorControl control(0.01, {.resolutions = resolutions});
    EXPECT_LE(view.error_of(view.run(control)), 0.0125);
    EXPECT_NEAR(control.estimate().file_error, 0.9 * 0.01 * file_error, 0.001);
    EXPECT_TRUE(control.estimate().reached);
  }
}

TEST(ErrorControl, SaysThatAllPointsHaveMoreThanTheError) {
  KnownView view({.file_error = 0.02, .all = 20000});
  ErrorControl control(0.004, {.resolutions = resolutions});
  const std::size_t cut = view.run(control);
  EXPECT_NEAR(control.estimate().file_error, 0.9 * 0.02, 0.002);
  EXPECT_LE(view.error_of(cut), 1.05 * 0.02);
}

// Of the last two steps to all points, one may be small by chance.
TEST(ErrorControl, SeesTheErrorOfAllPointsInTwoSteps) {
  KnownView view({.file_error = 0.008, .last_step = 0.5, .second_last_step = 4, .all = 100000});
  ErrorControl control(0.01, {.resolutions = resolutions});
  EXPECT_LE(view.error_of(view.run(control)), 0.0125);
  EXPECT_NEAR(control.estimate().file_error, 0.008, 0.001);
}

// Splats help little where all points have far more than the error.
TEST(ErrorControl, AddsTheErrorWhereAllPointsHaveMuchMore) {
  KnownView view({.file_error = 0.02, .all = 200000});
  ErrorControl control(0.005, {.resolutions = resolutions});
  const std::size_t cut = view.run(control);
  EXPECT_LE(view.error_of(cut), 1.2 * 0.02);
  EXPECT_LE(view.splats(cut), 1.5 * std::pow(1 / 0.005, 1 / 0.45));
}

TEST(ErrorControl, EndsAtTheCoarsestCut) {
  KnownView view({.scale = 1e-3});
  ErrorControl control(0.02, {.resolutions = resolutions});
  EXPECT_EQ(view.run(control), 0U);
  EXPECT_TRUE(control.estimate().reached);
  EXPECT_LE(control.pictures(), 4);
}

TEST(ErrorControl, EndsAtTheMostSplatsAndSaysSo) {
  KnownView view({});
  ErrorControl control(0.001, {.most_splats = 30000, .resolutions = resolutions});
  const std::size_t cut = view.run(control);
  EXPECT_LE(view.splats(cut), 30000);
  EXPECT_GT(view.splats(cut), 24000);
  EXPECT_FALSE(control.estimate().reached);
}

TEST(ErrorControl, EndsForAnEmptyPictureAndForOneCutOnly) {
  Image black{8, 8, std::vector<vec4>(64)};
  ErrorControl control(0.01, {.resolutions = resolutions});
  while (control.next({}) && control.pictures() < 20)
    control.add({.recipe = *control.next({}), .finest = true, .picture = &black}, {});
  EXPECT_FALSE(control.next({}));
  EXPECT_TRUE(control.estimate().reached);

  KnownView only({.coarsest = 100, .all = 101, .step = 2});
  ErrorControl of_only(1e-6, {.resolutions = resolutions});
  EXPECT_EQ(only.run(of_only), 1U);
}

TEST(ErrorControl, LearnsTheGoalThatFindsTheSameCut) {
  KnownView view({.expects = 0.2});
  ErrorControl control(0.01, {.resolutions = resolutions});
  const std::size_t cut = view.run(control);
  EXPECT_EQ(view.cut_of({.expected_error = 0.01 * control.learned() * (1 + 1e-9)}), cut);
}

TEST(ErrorControl, GrowsToThePictureThatIsFineEnough) {
  for (const double expects : {0.3, 1.0, 3.0}) {
    KnownView view({.scale = 1, .expects = expects});
    ErrorControl control(0.01, {.grows = true});
    std::uint64_t before = 0;
    while (control.next({})) {
      view.draw(control);
      EXPECT_GT(control.tried().back().splats, before) << "each picture is finer";
      before = control.tried().back().splats;
    }
    EXPECT_TRUE(control.estimate().reached);
    EXPECT_LE(view.error_of(view.last()), 0.0125) << expects;
    EXPECT_LE(view.drawn(), 16 * view.fewest(0.01)) << expects;
    EXPECT_NEAR(control.estimate().error / view.error_of(view.last()), 1, 0.3) << expects;
  }
}

TEST(ErrorControl, GrowsToAllPointsOrToTheMostSplats) {
  KnownView coarse({.coarsest = 500, .all = 5000});
  ErrorControl to_all(1e-6, {.grows = true});
  EXPECT_EQ(coarse.splats(coarse.run(to_all)), 5000);
  EXPECT_TRUE(to_all.estimate().reached) << "no more is in the file";

  KnownView view({});
  ErrorControl limited(1e-6, {.most_splats = 20'000, .grows = true});
  EXPECT_LE(view.splats(view.run(limited)), 20'000);
  EXPECT_FALSE(limited.estimate().reached);

  KnownView one_cut({.coarsest = 100, .all = 100});
  ErrorControl only(0.01, {.grows = true});
  one_cut.run(only);
  EXPECT_EQ(only.pictures(), 1);
}

TEST(ErrorControl, TakesASampleOfALargePicture) {
  KnownView view({.all = 30000, .width = 1200, .height = 900});
  ErrorControl control(0.02, {.resolutions = resolutions});
  const std::size_t cut = view.run(control);
  EXPECT_LE(view.error_of(cut), 1.25 * 0.02);
  EXPECT_LE(view.splats(cut), 1.5 * view.fewest(0.02));
}

}  // namespace
}  // namespace splatvol
