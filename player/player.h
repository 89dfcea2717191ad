// A .svol file and its pictures: opens the file, chooses splats and draws them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "base/error.h"
#include "format/steps.h"
#include "player/cell_pictures.h"
#include "player/error_control.h"
#include "player/motion_control.h"
#include "player/pacer.h"
#include "player/player_memory.h"
#include "player/recipe.h"
#include "player/scene_streamlines.h"
#include "renderer/device/device.h"
#include "renderer/rasterizer.h"
#include "renderer/surfaces/draw_surfaces.h"
#include "renderer/surfaces/surface.h"
#include "scene/scene.h"
#include "streamer/first/default_scene.h"
#include "streamer/splats/streamer.h"
#include "streamer/store/step_ahead.h"

namespace splatvol {

struct PlayerOptions {
  std::uint64_t memory = std::uint64_t{512} << 20;    // bytes to hold of what is read, and while it is drawn
  DrawnParts draws = DrawnParts::any;                 // what will be drawn: it has all of the memory
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;  // bytes that OpenGL may take
  Device device = Device::automatic;
  bool in_current_context = false;  // of OpenGL; else the rasterizer makes a context of its own if it needs one
  Drawing drawing = {};

  /// Called when parts of the file have come that a frame did not wait for: time to draw another. Runs on threads of
  /// the player, and must not call it: to wake the thread that draws.
  std::function<void()> on_data = {};

  /// Of a file that is opened without a scene: what its scene is to fit.
  FirstPicture first_picture = {};

  /// Whether tubes of streamlines come by set_tubes. Else they are read with the scene.
  bool takes_tubes = false;

  /// Reads the files of a scene's surfaces. Empty: scenes that show such surfaces are refused. The boundary needs none.
  ReadSurface read_surface = {};
};

/// Called with the share of a picture of cells that is done, in [0, 1].
using DrawProgress = std::function<void(double)>;

/// Seconds of the last frame.
struct PlayerTimes {
  double cut = 0;    // choosing the splats
  double fetch = 0;  // reading and decoding them
  FrameTimes draw;
  double frame = 0;     // all of it
  double surfaces = 0;  // of it, for surfaces and slices: fewer splats would hardly change it
};

/// An exact picture of the cells that a file keeps.
struct ExactPicture {
  std::uint64_t segments = 0;       // pieces of rays in a tetrahedron with a visible value
  std::uint64_t chunks = 0;         // of cells, that are in the view and may be visible
  std::uint64_t tetrahedra = 0;     // in these; about
  std::uint64_t unknown_cells = 0;  // of shapes that this program does not know: they are left out
  double segment_work = 1;          // of an estimate: as CellCounts has it

  [[nodiscard]] CellCounts counts() const {
    return {static_cast<double>(tetrahedra), static_cast<double>(segments), segment_work};
  }

  /// Returns the segments of a function of few pieces that are as much work.
  [[nodiscard]] double counted_segments() const { return segment_work * static_cast<double>(segments); }
};

/// What comparing pictures found out (ErrorControl).
struct ErrorSearch {
  ErrorControl::Estimate estimate;
  std::vector<ErrorControl::Tried> tried;  // cuts on the way to the last picture
  int pictures = 0;
  double learned = 1;
};

/// A quality, with an answer where nothing was asked.
struct ChosenQuality {
  Quality quality = {};

  /// If nothing was asked: the counted segments of an exact picture, if they are too many for one; else 0.
  std::uint64_t too_many_segments = 0;
};

/// How a picture was drawn (Player::draw_picture).
struct DrawnPicture {
  ChosenQuality chosen = {};
  std::optional<ErrorSearch> search = {};  // where the error of the picture was asked for, or nothing was
};

/// What a player has read of a file before a device draws it. Made on any thread (Player::read).
struct PlayerFile {
  format::Steps steps;
  std::size_t step;
  Scene scene;
  PlayerOptions options;
  std::shared_ptr<PlayerMemory> memory;  // of what follows
  std::unique_ptr<Streamer> streamer;    // of `step`; null: that of the player stays
  std::vector<Surface> surfaces;         // of `scene`
  std::vector<SceneTubes> tubes = {};    // likewise, unless they come by Player::set_tubes
};

/// An open file, its scene and a device that draws it. Errors name the file. All calls come from one thread, besides
/// `cancel`; with a device of OpenGL, its context is current in that thread.
class Player {
 public:
  /// Opens the last step of a file, or of an index of files (.svols), by its path or address. Without a scene: one that
  /// fits the data.
  [[nodiscard]] static Result<std::unique_ptr<Player>> open(const std::string& path,
                                                            const std::optional<Scene>& scene = std::nullopt,
                                                            const PlayerOptions& options = {});

  /// The same at a step that is there.
  [[nodiscard]] static Result<std::unique_ptr<Player>> open(format::Steps steps, std::size_t step,
                                                            const std::optional<Scene>& scene,
                                                            const PlayerOptions& options);

  /// What a player of the file holds, and need not be read again.
  struct Held {
    std::vector<Surface> surfaces = {};
    std::vector<SceneTubes> tubes = {};
    std::shared_ptr<PlayerMemory> memory = {};          // of options.memory bytes; null: none
    std::shared_ptr<const format::Volume> volume = {};  // at the step; null: to be opened
    std::optional<PartRoom> room = {};                  // of the same file, in this memory
  };

  /// The same in two parts, for a thread that reads while another one draws: `open` reads nothing.
  [[nodiscard]] static Result<PlayerFile> read(format::Steps steps, std::size_t step, const std::optional<Scene>& scene,
                                               const PlayerOptions& options, const Held& held);
  [[nodiscard]] static Result<std::unique_ptr<Player>> open(PlayerFile file);
  Player(const Player&) = delete;
  Player& operator=(const Player&) = delete;
  ~Player();

  /// Changes what is drawn. Another camera or size costs nothing, another function or lighting little; another
  /// attribute opens the file anew. Surfaces that are new are read. If it fails, all stays as it was.
  [[nodiscard]] Status set_scene(const Scene& scene);

  /// Returns what reads all that another scene, options and step need and that is not there; empty if all is there. It
  /// may run on another thread, and needs no player.
  using Reader = std::function<Result<PlayerFile>()>;
  [[nodiscard]] Reader reader(const Scene& scene, const PlayerOptions& options,
                              std::optional<std::size_t> step = std::nullopt) const;

  /// Takes over what a `reader` of this player has read. If it fails, all stays as it was.
  [[nodiscard]] Status replace(PlayerFile file);
  [[nodiscard]] const Scene& scene() const { return scene_; }
  [[nodiscard]] const View& view() const { return view_; }

  /// Changes an option. For another kernel, the file is opened anew. If it fails, all stays as it was.
  [[nodiscard]] Status set_drawing(const Drawing& drawing);

  /// Hides what lies behind opaque surfaces (Rasterizer::set_surface_depths), in all pictures until the next call: they
  /// must have the size of the depths. Null: no surfaces. If it fails, all stays as it was. Fails if the scene shows
  /// surfaces or slices.
  [[nodiscard]] Status set_surface_depths(std::shared_ptr<const SurfaceDepths> depths);

  /// Draws these tubes of streamlines from now on.
  void set_tubes(std::vector<SceneTubes> tubes);
  [[nodiscard]] const std::vector<SceneTubes>& tubes() const { return surfaces_.tubes; }

  /// Returns where streamlines are followed: at the step that is shown.
  [[nodiscard]] StreamlineFile streamline_file() const {
    return {streamer_->shared_volume(), memory_, streamer_->room()};
  }

  /// Returns a scene that fits the data; for the best attribute if `attribute` is empty.
  [[nodiscard]] Result<Scene> fitting_scene(const std::string& attribute = "", const FirstPicture& picture = {}) const;

  /// Returns the steps of a time series, in one file or in several; no times for another file.
  [[nodiscard]] const format::Steps& steps() const { return steps_; }
  [[nodiscard]] std::size_t step() const { return step_; }

  /// Changes to another step. If it fails, the step before stays.
  [[nodiscard]] Status show_step(std::size_t step);

  /// Begins to read another step on threads of their own, for `show_step`. Does nothing if there is no such step.
  /// `with_cells`: also all cells, where memory has room for them and the file is near.
  void read_ahead(std::size_t step, bool with_cells = false);

  /// Whether `show_step` would wait for what `read_ahead` reads.
  [[nodiscard]] bool is_reading_ahead() const;

  /// Chooses the splats of the next picture, and reads them. Draws nothing. The budgets may make it coarser than asked.
  /// `wait_seconds`: how long to wait for parts of the file. Until they come, their places are drawn coarser. None:
  /// waits for all, and fails if one cannot be read.
  [[nodiscard]] Status choose(const Detail& detail, std::optional<double> wait_seconds = std::nullopt);

  /// Draws the chosen splats. If the device has no room for them, chooses fewer. Splats have no contours: shells of the
  /// volume stand for them (with_shells). `sample_spacing`: as Recipe has it.
  [[nodiscard]] Status draw_chosen(int sample_spacing = 0);

  /// Draws a picture of splats, as `choose` and `draw_chosen`, or the exact one of cells. Cells are drawn on the
  /// processor, whatever the device; with surfaces, they have a sample in each pixel. Fails if the file keeps no cells,
  /// and as CellRasterizer::draw. Outcome::seconds is 0.
  [[nodiscard]] Result<Outcome> draw(const Recipe& recipe, std::optional<double> wait_seconds = std::nullopt,
                                     const DrawProgress& progress = {});

  /// Draws the next recipe of a chooser, and tells it what came of it. Returns false if there is none. Cells that a
  /// chooser takes are all read before the time counts, if memory has room for them.
  [[nodiscard]] Result<bool> draw_next(Chooser& chooser);

  /// Draws until the chooser is done.
  [[nodiscard]] Status draw_all(Chooser& chooser);

  /// Draws the picture of a quality. Where nothing is asked, that is `default_quality`.
  ///
  /// - An error: draws picture after picture, each with all of its parts, until one has it, or the finest that the file
  ///   and the budgets have: splats, or cells if drawing them is less work (ErrorControl). If nothing was asked, it
  ///   ends with the first picture that is fine enough.
  /// - All points, if nothing was asked: measures their error, too.
  /// - Milliseconds: draws what Pacer chooses; with an error, what MotionControl does. Splats are of parts that are
  /// there
  ///   or come in time. Learns the device's speed from call to call, so that the first calls may take longer, or do
  ///   less. Waits for the coarsest parts, whatever their time.
  /// - Else: waits for all parts, and fails if one cannot be read.
  ///
  /// Fails as check_quality and draw.
  [[nodiscard]] Result<DrawnPicture> draw_picture(const Quality& quality, const DrawProgress& progress = {});

  /// Returns what is drawn where nothing is asked, as Quality says: exact cells, or splats. Splats alone for OpenGL,
  /// and where PlayerOptions::drawing tells how to draw them. Contours are exact, whatever the work.
  [[nodiscard]] Result<ChosenQuality> default_quality();

  /// Returns what the view has. Estimates cells, if they are needed and can be drawn. With surfaces or slices,
  /// `widest_spacing` is 1.
  [[nodiscard]] Result<Choices> choices(const Chooser::Needs& needs);

  /// Draws splats beside the last exact picture, which stays, and measures their error against it. Returns nothing if
  /// parts of the file are missing. Chooses splats anew. Requires a rasterizer of the processor.
  [[nodiscard]] Result<std::optional<Outcome>> try_splats(const Recipe& recipe);

  /// Returns from which difference on wide samples of cells are refined in the present scene, as CellDrawing's. 0:
  /// never.
  [[nodiscard]] float refined_difference() const;

  /// Tells of a picture of cells how many chunks and about how many pieces of rays it draws. Reads what chunks the file
  /// has. Fails if it keeps no cells.
  [[nodiscard]] Result<ExactPicture> estimate_exact();

  /// Whether shells stand for contours in the last picture.
  [[nodiscard]] bool shows_shells() const { return shows_contours() && !exact_; }

  /// Whether the scene shows contours: only cells have them.
  [[nodiscard]] bool shows_contours() const { return !contours_of(scene_).surfaces.empty(); }

  /// Whether the file keeps cells.
  [[nodiscard]] bool has_cells() const;

  /// Reads all cells, if memory has room for them: then exact pictures read nothing more. Fails if the file keeps none.
  [[nodiscard]] Status hold_cells();

  /// Whether they are held.
  [[nodiscard]] bool holds_cells() const;

  /// Returns what reads all cells, on any thread and beside other calls: then they are held. Empty if they are, if
  /// there are none or no room, and if the file is far.
  [[nodiscard]] std::function<Status()> cells_reader();

  /// Returns the cells that picks ask, as CellPictures::shared; none if the file keeps none.
  [[nodiscard]] std::optional<SharedCells> cells_for_picks();

  /// Returns the function by which splats are drawn: with shells in place of contours.
  [[nodiscard]] const TransferFunction& function_of_splats() const { return function_of_splats_; }

  /// Draws the last frame again, from a place too near to be seen apart: a frame of a moving camera, to be timed.
  [[nodiscard]] Status draw_again();

  /// As the function of this name (streamer/domain.h). Chooses splats anew.
  [[nodiscard]] Result<Box> find_domain();

  /// Ends the call that is in progress in another thread: it fails with ErrorCode::cancelled, within a tenth of a
  /// second besides the time of a frame. Does nothing to later calls. Thread-safe.
  void cancel();

  /// Returns the splats of the last frame, also after an exact picture. Null before the first, and after a call that
  /// failed.
  [[nodiscard]] const FrameSplats* frame() const { return frame_; }

  /// Returns what is known of the last picture if it is exact; else nothing.
  [[nodiscard]] const std::optional<ExactPicture>& exact() const { return exact_; }

  /// Returns what came of the last picture, without its time. Requires one.
  [[nodiscard]] Outcome outcome() const;

  /// Returns the detail that was asked for in the last frame.
  [[nodiscard]] const Detail& asked_detail() const { return asked_.detail; }

  /// Returns how the last frame was drawn.
  [[nodiscard]] SortMode sort() const { return sort_; }
  [[nodiscard]] int sample_spacing() const { return sample_spacing_; }
  [[nodiscard]] const PlayerTimes& times() const { return times_; }

  /// Returns the picture of the last `draw` with its surfaces and slices.
  [[nodiscard]] DevicePicture picture() const { return picture_ ? &*picture_ : rasterizer_->picture(); }

  /// Returns a copy of it, in linear premultiplied RGBA.
  [[nodiscard]] Result<Image> image() const;

  /// Returns it where it lies, or a copy in `copy` if it lies on a device. Valid until the next picture.
  [[nodiscard]] Result<const Image*> image_or_copy(Image& copy) const;

  /// Whether surfaces or slices were in the last picture, or it is exact. Then the rasterizer has only a part of it, or
  /// nothing.
  [[nodiscard]] bool has_drawn_surfaces() const { return picture_.has_value(); }

  /// Whether layers of translucent surfaces were joined in the last picture (draw_surfaces).
  [[nodiscard]] bool has_joined_surfaces() const { return picture_ && surfaces_.layers.is_joined; }

  /// Returns the surfaces of the scene, and then the tubes of its streamlines.
  [[nodiscard]] const std::vector<Surface>& surfaces() const { return surfaces_.drawn; }

  /// Returns the error of patches that the pictures lack: the triangles of the boundary that a scene shows may take a
  /// quarter of PlayerOptions::memory, and the largest patches beyond are left out. None if all are drawn.
  [[nodiscard]] std::optional<Error> left_out() const;

  /// Returns the splats that the device has room for beside the picture; 2^32 - 1 if it knows no limit.
  [[nodiscard]] std::uint64_t device_splats() const;

  [[nodiscard]] const PlayerOptions& options() const { return options_; }
  [[nodiscard]] const format::VolumeInfo& info() const { return streamer_->info(); }
  [[nodiscard]] const Streamer& streamer() const { return *streamer_; }
  [[nodiscard]] const Rasterizer& rasterizer() const { return *rasterizer_; }

 private:
  class Call;

  Player(format::Steps steps, std::size_t step);
  [[nodiscard]] Status use(const Scene& scene, const PlayerOptions& options);
  [[nodiscard]] Status check_surfaces(const Scene& scene, const View& view) const;
  [[nodiscard]] Status take_over(const Scene& scene, const PlayerOptions& options, std::unique_ptr<Streamer> streamer,
                                 const std::shared_ptr<PlayerMemory>& memory, const View& view);
  [[nodiscard]] Status open_again(std::size_t step);
  [[nodiscard]] Status change_step(std::size_t step);
  [[nodiscard]] std::vector<Surface> surfaces_of_all_steps() const;
  [[nodiscard]] Status read_boundary_of(const format::Volume& volume);
  [[nodiscard]] Status read_values_of(std::size_t step, std::shared_ptr<const format::Volume> volume);
  [[nodiscard]] Result<Outcome> draw_in(const Recipe& recipe, double seconds);
  [[nodiscard]] Result<Outcome> draw_steadily(const Recipe& recipe);
  [[nodiscard]] Status draw_cells(int sample_spacing, const DrawProgress& progress);
  [[nodiscard]] bool may_draw_cells() const;

  // Exact rays, and the work of an exact picture.
  struct DrawnRays {
    Rays rays;
    CellCounts cells;
  };
  [[nodiscard]] Result<std::optional<DrawnRays>> draw_rays();
  [[nodiscard]] Result<std::optional<ErrorSearch>> draw_all_points();
  [[nodiscard]] Result<ErrorSearch> draw_to_error(double max_error, bool grows);
  [[nodiscard]] View view_now() const;
  [[nodiscard]] Status set_draw_list();
  [[nodiscard]] Result<FrameTimes> draw_volume(const View& view);
  [[nodiscard]] Result<FrameTimes> draw_with_surfaces(const View& view);
  void lay_surfaces(const View& view, bool has_slices);
  [[nodiscard]] Result<std::vector<CellLayer>> lay_cells();
  void take_surfaces(std::vector<Surface> surfaces);
  void join_surfaces();
  [[nodiscard]] Status read_tubes_of(std::size_t step, std::shared_ptr<const format::Volume> volume);
  [[nodiscard]] Result<std::shared_ptr<const FileCells>> open_cells();
  [[nodiscard]] bool shows_surfaces() const;
  // Whether something opaque or translucent stands among the splats: it needs a sample in each pixel.
  [[nodiscard]] bool has_layers() const { return shows_surfaces() || surfaces_.depths; }
  [[nodiscard]] tl::unexpected<Error> fail_lost() const;
  [[nodiscard]] std::vector<SlicePicture> draw_slices(const View& view) const;

  format::Steps steps_;
  std::size_t step_;
  std::shared_ptr<PlayerMemory> memory_;  // before what lies in it
  using VolumeAhead = StepAhead<Result<std::shared_ptr<const format::Volume>>>;
  std::unique_ptr<VolumeAhead> ahead_;  // of a series of files
  PlayerOptions options_;
  Scene scene_;
  TransferFunction function_of_splats_;  // the scene's, with shells in place of contours
  View view_;
  std::uint64_t revision_ = 0;  // of what pictures show
  bool is_lost_ = false;        // the streamer has no step; only to be opened again
  std::unique_ptr<Streamer> streamer_;
  std::unique_ptr<Rasterizer> rasterizer_;
  std::uint64_t room_ = 0;  // splats that the rasterizer took, as far as is known
  CellPictures cells_;

  struct Surfaces {
    std::shared_ptr<const SurfaceDepths> depths = {};  // of another program
    std::vector<Surface> all = {};                     // of the scene
    std::vector<SceneTubes> tubes = {};                // likewise
    std::vector<Surface> drawn = {};                   // both
    Reservation patches_room = {};                     // while surfaces are patches
    SurfaceLayers layers = {};                         // of the last picture with surfaces or slices
    std::optional<View> view = {};                     // shows the layers; none: they are to be drawn
  };
  Surfaces surfaces_;

  // Of the last frame.
  struct Asked {
    Detail detail = {};
    std::optional<double> seconds = {};  // to wait
    int sample_spacing = 0;
    bool is_nudged = false;  // by draw_again
  };
  Asked asked_;

  // Of the last picture.
  std::optional<Image> picture_;  // if surfaces were in it or it is exact
  const FrameSplats* frame_ = nullptr;
  std::optional<ExactPicture> exact_;
  SortMode sort_ = SortMode::exact;
  int sample_spacing_ = 1;
  PlayerTimes times_;

  Pacer pacer_{1};
  MotionControl motion_;

  // That are in progress, one within the other.
  struct Calls {
    std::mutex mutex;
    std::stop_source stop;
    int count = 0;

    [[nodiscard]] std::stop_token begin();
  };
  Calls calls_;
};

}  // namespace splatvol
