// The picture of a file at rest, and how it gets finer.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <optional>
#include <set>
#include <thread>
#include <utility>

#include "base/file.h"
#include "format/volume.h"
#include "pictures/outline.h"
#include "renderer/cpu/srgb_bytes.h"
#include "tests/player/session_fixture.h"

namespace splatvol::test {
namespace {

// A file with more points than are drawn at once.
struct SessionAtRest : SessionFixture {
  static void SetUpTestSuite() {
    folder.emplace();
    const auto waves = [](dvec3 p) { return std::sin(20 * p.x) * std::cos(17 * p.y) + std::sin(9 * p.z); };
    build_mesh(lattice(84), waves, folder->path("m.svol"));
  }
  static void TearDownTestSuite() { folder.reset(); }

  [[nodiscard]] std::unique_ptr<Session> open() const { return SessionFixture::open(folder->path("m.svol")); }

  // Waits for what a job fits.
  void fitted(Session& session) const {
    while (session.is_fitting()) {
      draw(session);
      std::this_thread::yield();
    }
  }

  static inline std::optional<TempFolder> folder;
};

TEST_F(SessionAtRest, HasTheWantedError) {
  settings.quality.tolerance_percent = 0;
  const auto of_all = open();
  const Image all = settled(*of_all);
  EXPECT_EQ(of_all->frame()->splats, of_all->info().point_count());
  for (const double error : {0.02, 0.005, default_max_error}) {
    settings.quality = {.max_error = error};
    const auto session = open();
    const Image image = settled(*session);
    EXPECT_LE(compare_images(image, all)->rmse, 1.25 * error);
    EXPECT_TRUE(session->refinement()->has_reached());
    EXPECT_LT(session->frame()->splats, session->info().point_count()) << error;
  }
}

TEST_F(SessionAtRest, HasTheSplatsOrTheResolutionOfAScene) {
  const auto session = open();
  const Drawing drawing{.kernel = KernelKind::moments, .sort = SortMode::axis, .sample_spacing = 2};
  for (const Quality& quality : {Quality{.max_splats = 5000}, Quality{.resolution = 1}}) {
    ASSERT_TRUE(session->use({.quality = quality, .drawing = drawing}));
    settled(*session);
    const FrameSplats& frame = *session->frame();
    if (quality.max_splats) {
      EXPECT_EQ(frame.detail.goal->max_splats, 5000U);
      EXPECT_LE(frame.splats, 5000U);
    } else {
      EXPECT_EQ(frame.detail.resolution, 1U);
    }
    EXPECT_FALSE(session->refinement()->seeks_error());
    EXPECT_EQ(session->used_scene().use.quality, quality);
    EXPECT_EQ(session->used_scene().use.drawing, drawing);
  }
}

TEST_F(SessionAtRest, SharpensAndIsInterrupted) {
  settings.quality.max_error = 1e-4;
  settings.moving.max_error = 1;  // the first picture at rest is about as fine as what moves
  const auto session = open();
  settled(*session);
  const std::uint64_t finest = session->frame()->splats;
  session->scene.camera.position += 0.1 * (session->scene.camera.position - session->scene.camera.focal_point);
  draw(*session, 0.01);
  EXPECT_FALSE(session->refinement()) << "it moves";
  EXPECT_TRUE(session->frame()->detail.goal);

  // The first picture at rest is not the finest: a user who moves again does not wait for it.
  while (session->is_drawing()) draw(*session, 0.0001);
  draw(*session, long_time);
  ASSERT_TRUE(session->refinement());
  EXPECT_FALSE(session->is_settled());
  EXPECT_LT(session->frame()->splats, finest / 4);
  session->scene.camera.position += 0.1 * (session->scene.camera.position - session->scene.camera.focal_point);
  do draw(*session, 0.0001);
  while (session->is_drawing());  // the picture that is given up
  EXPECT_FALSE(session->refinement());
  settled(*session);
  EXPECT_GT(session->frame()->splats, finest / 4);

  // Another error begins anew.
  session->settings.quality.max_error = 0.05;
  draw(*session, 0.01);
  EXPECT_FALSE(session->is_settled());
  settled(*session);
  EXPECT_LT(session->frame()->splats, finest);
}

// A picture that took a while is shown, though the next one is being drawn by then.
TEST_F(SessionAtRest, EachPictureIsShown) {
  settings.quality.max_error = 1e-4;
  width = 600, height = 450;
  const auto session = open();
  std::vector<std::uint8_t> before, last;
  Detail detail;
  int pictures = 0;
  for (int frames = 0; !session->is_settled() && frames < 10000; ++frames) {
    draw(*session);
    const Result<ShownPicture> picture = session->shown_picture();
    ASSERT_TRUE(picture) << picture.error().message;
    ASSERT_TRUE(picture->encoded);
    EXPECT_TRUE(picture->is_new || picture->encoded->bytes == last);
    last = picture->encoded->bytes;
    const Detail detail_before = std::exchange(detail, session->refinement()->detail());
    if (frames == 0 || detail == detail_before) continue;  // none has been finished
    EXPECT_EQ(picture->encoded->bytes.size(), std::size_t{4} * 600 * 450);
    EXPECT_TRUE(picture->encoded->bytes != before) << "the picture before stayed";
    before = picture->encoded->bytes;
    ++pictures;
  }
  EXPECT_GE(pictures, 2);
}

// Only what is round the picture changes: it is laid over another background, and not drawn again.
TEST_F(SessionAtRest, AnotherBackgroundIsShownAtOnce) {
  const auto session = open();
  settled(*session);
  const std::uint64_t serial = session->frame()->serial;
  for (const dvec3& background : {dvec3(0), dvec3(1, 0, 1)}) {
    session->scene.background = background;
    draw(*session);
    const Result<ShownPicture> picture = session->shown_picture();
    ASSERT_TRUE(picture) << picture.error().message;
    const std::vector<std::uint8_t>& shown = picture->encoded->bytes;
    EXPECT_EQ(shown[0], background.r == 0 ? 0 : 255);
    EXPECT_EQ(shown[1], 0);
    EXPECT_TRUE(session->is_settled());
    EXPECT_EQ(session->frame()->serial, serial);
  }
}

// The window shows the outline as saved pictures do, and as soon as it is switched on.
TEST_F(SessionAtRest, TheOutlineIsBehindTheVolume) {
  const auto session = open();
  session->scene.outline = false;
  for (auto& density : session->scene.transfer_function.densities) density.extinction = 1e6;
  const Image picture = settled(*session);
  const std::uint64_t number = session->shown_number();
  const auto shown = [&] {
    draw(*session);
    return session->shown_picture().value().encoded->bytes;
  };
  const auto bytes_of = [&](const Image& image) {
    std::vector<std::uint8_t> bytes;
    encode_srgb(image, session->scene.background, bytes);
    return bytes;
  };
  EXPECT_EQ(shown(), bytes_of(picture));
  session->scene.outline = true;
  const auto with_outline = shown();
  EXPECT_EQ(session->shown_number(), number) << "the same picture";
  Image outlined = picture;
  draw_outline(outlined, session->view(), session->bounds(), ink_on(session->scene.background));
  EXPECT_EQ(with_outline, bytes_of(outlined));
  EXPECT_NE(with_outline, bytes_of(picture));
}

TEST_F(SessionAtRest, ColoursAreSpreadAndTakenBack) {
  const auto session = open();
  settled(*session);
  Scene& scene = session->scene;
  scene.transfer_function.lo = -10, scene.transfer_function.hi = 10;
  scene.transfer_function.colors = {{0, dvec3(0)}, {1, dvec3(1)}};
  scene.transfer_function.densities = {{0, 1}};
  settled(*session);
  session->remember();
  const TransferFunction before = scene.transfer_function;
  session->show_visible();
  fitted(*session);
  const TransferFunction visible = scene.transfer_function;
  EXPECT_NE(visible.colors, before.colors);
  EXPECT_EQ(visible.densities, before.densities);
  session->undo();
  EXPECT_EQ(scene.transfer_function, before);
}

TEST_F(SessionAtRest, TheAxisThatIsUpStays) {
  const auto session = open();
  settled(*session);
  EXPECT_EQ(session->up_axis(), 1);
  session->choose_up(2);
  EXPECT_EQ(session->scene.camera.up, dvec3(0, 0, 1));
  session->scene.camera.position += dvec3(3, 1, 2);
  session->show_all();
  fitted(*session);
  EXPECT_EQ(session->scene.camera.up, dvec3(0, 0, 1));
  EXPECT_EQ(session->up_axis(), 2);
}

// Pictures at rest are drawn aside, and given up if the view changes.
TEST_F(SessionAtRest, NobodyWaitsForAPicture) {
  settings.quality.tolerance_percent = 0;
  width = 900, height = 700;
  const auto session = open();
  const Image whole = settled(*session);
  const Camera camera = session->scene.camera;
  int given_up = 0;
  for (int tries = 0; tries < 20; ++tries) {
    session->scene.camera.position += dvec3(0.01);
    draw(*session, 0.001);
    for (int frames = 0; !session->is_drawing() && !session->is_settled() && frames < 10000; ++frames) draw(*session);
    given_up += session->is_drawing() ? 1 : 0;
  }
  EXPECT_GT(given_up, 0) << "each picture of 6e5 splats was there at once";
  session->scene.camera = camera;
  EXPECT_EQ(compare_images(settled(*session), whole)->max, 0);
  session->scene.camera.position += dvec3(0.01);
  draw(*session);  // may still be drawing at its end
}

TEST_F(SessionAtRest, DrawsTheSameWithoutHurry) {
  settings.hurries = false;
  const auto session = open();
  draw(*session, 0);
  EXPECT_TRUE(session->refinement());
  const Image first = settled(*session);
  const Camera camera = session->scene.camera;
  session->scene.camera.position += dvec3(0.2);
  const std::uint64_t finest = session->frame()->splats;
  draw(*session, 0);
  EXPECT_FALSE(session->is_settled());
  EXPECT_LT(session->refinement()->detail().goal->max_splats, finest) << "another view begins with a coarse picture";
  settled(*session);
  session->scene.camera = camera;
  EXPECT_EQ(compare_images(first, settled(*session))->max, 0);
}

// A disk that fails: after a thousand parts that cannot be read, the picture stays coarse and comes to rest.
TEST_F(SessionAtRest, IsReachedThoughAThousandPartsAreUnreadable) {
  const std::string damaged = path("damaged.svol");
  const auto waves = [](dvec3 p) { return std::sin(20 * p.x); };
  build_mesh(lattice(40), waves, damaged, {.points_per_chunk = {{64}}});
  const auto volume = *format::Volume::open(*open_file(damaged));
  const auto rows = std::ranges::find(volume->sections(), format::SectionKind::rows, &format::SectionEntry::kind);
  std::string bytes = *read_text_file(damaged);
  for (std::uint64_t i = rows->packed_bytes / 16; i < rows->packed_bytes; i += 64) bytes[rows->offset + i] ^= 0x55;
  std::ofstream(damaged, std::ios::binary) << bytes;

  settings.quality.tolerance_percent = 0;
  for (const bool hurries : {true, false}) {
    settings.hurries = hurries;
    const auto session = SessionFixture::open(damaged);
    settled(*session);
    const std::vector<std::string>& troubles = session->troubles();
    EXPECT_GE(troubles.size(), 1000u);
    EXPECT_EQ(std::set<std::string>(troubles.begin(), troubles.end()).size(), troubles.size()) << "each once";
    EXPECT_GT(session->frame()->splats, 0u);
    // A moved camera comes to rest, too.
    session->scene.camera.position += dvec3(0.1);
    settled(*session);
  }
}

// Among splats, slices that move may have a smaller picture. The window stretches it.
TEST_F(SessionAtRest, SlicesMove) {
  const auto session = open();
  session->scene.slices = {{.point = dvec3(0.5), .normal = {0, 0, 1}}};
  EXPECT_EQ(settled(*session).width, 200);
  session->scene.camera.position += 0.1 * (session->scene.camera.focal_point - session->scene.camera.position);
  do draw(*session, 0);
  while (session->is_drawing());
  const Image moving = session->image().value();
  const int spacing = session->shown_recipe().recipe.sample_spacing;
  EXPECT_EQ(moving.width, (200 + spacing - 1) / spacing);
  EXPECT_EQ(session->view().width, 200);
  const Image at_rest = settled(*session);
  EXPECT_EQ(at_rest.width, 200);
  Image smaller{moving.width, moving.height, std::vector<vec4>(moving.pixels.size())};
  for (int y = 0; y < moving.height; ++y)
    for (int x = 0; x < moving.width; ++x)
      for (int i = 0; i < spacing * spacing; ++i)
        smaller.at(x, y) +=
            at_rest.at(std::min(spacing * x + i % spacing, 199), std::min(spacing * y + i / spacing, 149)) /
            static_cast<float>(spacing * spacing);
  EXPECT_LT(compare_images(moving, smaller)->rmse, 0.05) << "the same view";
}

}  // namespace
}  // namespace splatvol::test
