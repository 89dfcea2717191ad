// A file that somebody looks at. Decides how fine a picture there is time for.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <unordered_set>
#include <utility>
#include <vector>

#include "base/addresses.h"
#include "base/error.h"
#include "format/steps.h"
#include "format/volume.h"
#include "pictures/page.h"
#include "player/conversion.h"
#include "player/history.h"
#include "player/motion_control.h"
#include "player/player.h"
#include "player/progressive_refinement.h"
#include "player/session_host.h"
#include "renderer/rasterizer.h"
#include "scene/scene.h"
#include "streamer/first/default_scene.h"

namespace splatvol {

/// After this time without a change, in seconds, the picture becomes finer.
inline constexpr double pause_seconds = 0.15;

/// What a picture is made of, and what is known of its error.
struct ShownRecipe {
  Recipe recipe = {};        // as it was drawn
  bool moves = false;        // drawn while something moved
  double error = 0;          // of one that moves; root mean square of linear RGB
  bool is_measured = false;  // the error, in about this view; else it is expected
};

/// A picture that is complete, before it is shown.
struct CompletePicture {
  std::uint64_t number;  // of the session's pictures, from 1 on
  const Image& image;    // linear and premultiplied; valid during the call
  const Scene& scene;
  std::size_t step;
  const ShownRecipe& recipe;
  double seconds;  // from its beginning until it can be shown
};

/// How the file is to be shown, named like svrender's options.
struct ViewSettings {
  std::uint64_t memory = std::uint64_t{512} << 20;
  std::uint64_t gpu_memory = std::uint64_t{1} << 30;
  Device device = Device::automatic;
  bool in_current_context = true;   // of OpenGL; else the renderer makes a context of its own if it needs one
  Quality quality = {};             // at rest, without milliseconds; a small file shows all points instead of an error
  Drawing drawing = {};             // at rest
  bool hurries = true;              // coarser pictures while something moves; false: nobody waits
  MotionLimits moving = {};         // how good these are
  ReadSurface read_surface = {};    // as in PlayerOptions
  FirstPicture first_picture = {};  // as in PlayerOptions; its size may turn out to be another

  // Whether a thread reads what another attribute, kernel or memory, or surfaces need, while pictures are drawn without
  // the change, and draws what moves. Else the next draw does both.
  bool works_aside = true;

  // Segments that a picture may have to be of cells, in all of its samples, unless `quality` asks for an exact one; 0:
  // splats.
  std::uint64_t most_exact_segments = splatvol::most_exact_segments;

  // Called by `draw` with each picture of the processor that will be shown.
  std::function<void(const CompletePicture&)> on_picture = {};
};

/// How a mesh is converted.
struct Conversion {
  std::function<void(const ConversionProgress&)> tell = {};  // called on the thread that reads
  std::string preview = {};                                  // as in ConversionRequest
  bool all_steps = false;                                    // else the last one, unless a step is asked for
};

/// What a session reads of a file. Made on any thread (Session::read).
struct SessionFile {
  std::string path;
  std::vector<std::string> pieces = {};         // of the mesh
  std::optional<ConvertedFile> converted = {};  // from a mesh
  bool fits = false;                            // the scene is one that fits the data
  ViewSettings settings = {};
  PlayerFile file;
  Box bounds = {};                                     // of the material
  Box mesh_box = {};                                   // as bounds, if the file keeps no cells
  std::array<std::uint64_t, 64> histogram{};           // of the scene's attribute
  Scene fitting = {};                                  // fits the scene's attribute, on the scene's background
  std::array<std::uint64_t, 64> opacity_histogram{};   // of the opacity attribute, if there is one
  std::optional<FittingOpacity> fitting_opacity = {};  // if it is to fit
};

/// A picture of the processor as a screen takes it: sRGB bytes of red, green, blue and alpha over the background, with
/// the scene's outline, the highest row first. Its width is 0 before the first.
struct EncodedPicture {
  int width = 0, height = 0;
  std::vector<std::uint8_t> bytes = {};
};

/// A picture for a screen.
struct ShownPicture {
  TexturePicture texture{};                 // linear and premultiplied, unless there are bytes
  const EncodedPicture* encoded = nullptr;  // null: the texture
  bool is_new = true;                       // the bytes are not those of the call before
};

/// Draws one file. Draws only after a change. Knows of no window and no threads: a host runs jobs, and outlives the
/// session. Needs the context of OpenGL that was current at `open`, if `settings` say so.
class Session {
 public:
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  ~Session();

  /// Opens a volume with a scene; `scene_path` empty: with a scene that fits the data. Errors name the file or the
  /// scene.
  [[nodiscard]] static Result<std::unique_ptr<Session>> open(const std::string& path, const std::string& scene_path,
                                                             const ViewSettings& settings, SessionHost& host);

  /// The same in two parts, for a thread that reads while another one draws. `asked` goes before what the scene tells
  /// of its use, and this before `settings`. A scene that tells its file needs no other.
  [[nodiscard]] static Result<SessionFile> read(const SceneUse& asked, const std::string& scene_path,
                                                const ViewSettings& settings,
                                                const format::OpenFile& open_file = open_file_or_url,
                                                const Conversion& conversion = {});
  /// Reads nothing, and nor does the first picture.
  [[nodiscard]] static Result<std::unique_ptr<Session>> open(SessionFile file, SessionHost& host);

  /// Updates the picture for `scene` and `settings`. While they change, pictures are as good as `settings.moving` says.
  /// At rest they become finer from call to call, and exact in the end if the file keeps cells. `seconds`: since the
  /// last call. A picture that cannot be drawn is tried again after a change; until then, each call fails alike. While
  /// `is_busy`, somebody uses the interface, and would wait for a finer picture: none is drawn.
  ///
  /// Where jobs draw, a picture of what moves begins with the newest scene, and is shown by a later call, whatever has
  /// changed by then. A picture at rest ends with a change.
  [[nodiscard]] Status draw(int width, int height, double seconds, bool is_busy = false);

  /// Whether a job draws a picture: calls of `draw` do not wait for it long. Then `image` and `page` must not be
  /// called; `shown_picture` is the one before.
  [[nodiscard]] bool is_drawing() const { return drawing_.is_begun(); }

  /// Whether it is still at work.
  [[nodiscard]] bool awaits_picture() const { return is_drawing() && !drawing_.wait(); }

  /// Whether a job reads what a change needs: another attribute, kernel, memory or step, or surfaces. Until it is
  /// there, pictures are drawn without the change.
  [[nodiscard]] bool is_reading() const { return reading_.has_value(); }

  /// Takes back the change that is_reading() tells of, or that of is_fitting().
  void cancel_reading();

  /// Returns whether another call without a change would draw the same.
  [[nodiscard]] bool is_settled() const { return settled_ && !reading_ && !asked_step_ && !fitting_; }

  /// Returns the transfer function that fits the attribute that is drawn, on the background of `scene`.
  [[nodiscard]] TransferFunction fitting_function() const;

  /// Gives the scene a camera that sees all that the file shows, in the size of the last picture, with `up_axis`
  /// upwards. Coarse splats are read for it, by a job where changes are read aside. A camera that moves meanwhile
  /// stays.
  void show_all();

  /// Spreads the colours over the values that are seen (streamer/first/default_scene.h), likewise.
  void show_visible();
  [[nodiscard]] bool is_fitting() const { return fitting_.has_value(); }

  /// Chooses the axis that is upwards. The camera turns about its line of sight, unless it looks along the axis.
  void choose_up(int axis);
  [[nodiscard]] int up_axis() const { return up.value_or(up_axis_of(info())); }

  /// Shows another attribute of the file, with a transfer function that fits it. The camera stays.
  void show_attribute(const std::string& name);

  /// Gives the scene an opacity by an attribute that fits the data; empty: none. What it needs is read as for any
  /// change.
  void show_opacity(const std::string& name);

  /// Returns the times of the steps of a time series, in one file or in several; none for another file.
  [[nodiscard]] const std::vector<double>& times() const { return player_->steps().times(); }

  /// The file, or the files of a series.
  [[nodiscard]] const format::Steps& steps() const { return player_->steps(); }

  /// Returns the number of the step that is shown, or asked for; 0 for a file that is no series.
  [[nodiscard]] std::size_t step() const { return asked_step_.value_or(player_->step()); }

  /// Shows another step of a series. Camera and transfer function stay. The picture stays that of the step before until
  /// there is one as fine as a moving picture is. If the step cannot be read, the one before stays.
  [[nodiscard]] Status show_step(std::size_t step);

  /// The same for a hand that waits for nothing: unless it has been read ahead, the step is read like any other change,
  /// as is_reading() tells. troubles() tell what cannot be read.
  void ask_step(std::size_t step);

  /// The same by a hand that stops what plays. Does nothing if there is no such step.
  void choose_step(std::size_t step);

  /// Begins to play the steps, at the last one from the first one on; or stops.
  void toggle_playing();
  void stop_playing() { step_seconds_.reset(); }
  [[nodiscard]] bool is_playing() const { return step_seconds_.has_value(); }

  /// Shows the next step once the picture of this one has been there for its time and the next one has been read. If a
  /// file cannot be read, or that is taken back, it is the end. `seconds`: since the last call.
  [[nodiscard]] Status play(double seconds);

  /// Adds the scene to those that it went through, if it has changed and there is a picture.
  void remember();

  /// Go to the scene before, or to the one that was undone last.
  void undo();
  void redo();
  [[nodiscard]] bool can_undo() const { return history_ && history_->can_undo(); }
  [[nodiscard]] bool can_redo() const { return history_ && history_->can_redo(); }

  /// Whether the picture is that of `step()`, and so fine.
  [[nodiscard]] bool is_step_shown() const { return !awaits_step_ && !asked_step_; }

  /// Begins to read another step of a series. Does nothing if there is no such step.
  void read_ahead(std::size_t step) {
    if (is_drawing()) return;
    player_->read_ahead(step, first_exact_spacing() > 0);
    read_ahead_ = step;
  }

  /// Whether `show_step` would wait for what `read_ahead` reads.
  [[nodiscard]] bool is_reading_ahead() const {
    return is_drawing() ? before_.is_reading_ahead : player_->is_reading_ahead();
  }

  /// Returns the range of the shown attribute's values over all steps.
  [[nodiscard]] format::StepRange range_of_all_steps() const {
    return player_->steps().range_of(used_scene_.attribute);
  }

  /// Returns why the picture shows nothing, or only one colour; empty if it does show something.
  [[nodiscard]] std::string explain() const;

  [[nodiscard]] const format::VolumeInfo& info() const { return player_->info(); }
  /// Returns the attribute that is drawn, with the unit that the scene tells.
  [[nodiscard]] format::Attribute attribute() const;

  /// Returns the attribute by whose values the picture is coloured (bar_colors_of), with the unit of the scalar bar.
  [[nodiscard]] format::Attribute bar_attribute() const;

  /// Returns the opacity attribute of the picture, if there is one.
  [[nodiscard]] std::optional<format::Attribute> opacity_attribute() const;
  [[nodiscard]] const std::array<std::uint64_t, 64>& histogram() const { return histogram_; }
  [[nodiscard]] const std::array<std::uint64_t, 64>& opacity_histogram() const { return opacity_histogram_; }
  [[nodiscard]] const std::string& path() const { return path_; }

  /// Returns the file that a mesh became, if it is one.
  [[nodiscard]] const std::optional<ConvertedFile>& converted() const { return converted_; }

  /// Removes that file from the cache. It stays open, and is none that a mesh became any more.
  [[nodiscard]] Status forget_converted();
  [[nodiscard]] std::uint64_t file_bytes() const { return player_->streamer().volume().file_bytes(); }
  [[nodiscard]] const Scene& first_scene() const { return first_scene_; }

  /// Returns the scene with what is needed to show the same elsewhere: file, step, detail and kernel.
  [[nodiscard]] UsedScene used_scene() const;

  /// Takes over what a scene tells of its use, besides its file.
  [[nodiscard]] Status use(const SceneUse& use);

  /// Returns the scene of the last draw. It lacks what is being read.
  [[nodiscard]] const Scene& drawn_scene() const { return used_scene_; }

  /// Returns a box round the material of the coarsest splats.
  [[nodiscard]] const Box& bounds() const { return bounds_; }

  /// Returns the box round the mesh's cells; as bounds() if the file keeps none.
  [[nodiscard]] const Box& mesh_box() const { return mesh_box_; }

  /// Returns the splats of the last draw; while `is_drawing`, those of the draw before, without their list. Null before
  /// the first.
  [[nodiscard]] const FrameSplats* frame() const {
    if (!is_drawing()) return player_->frame();
    return before_.frame ? &*before_.frame : nullptr;
  }

  /// Returns what is known of the last picture if it is exact; else nothing.
  [[nodiscard]] const std::optional<ExactPicture>& exact() const {
    return is_drawing() ? before_.exact : player_->exact();
  }
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const {
    return is_drawing() ? before_.nodes : player_->streamer().drawn_nodes();
  }

  /// Returns the view of the picture that is shown, in the size of the window's picture.
  [[nodiscard]] const View& view() const { return shown_number_ > 0 ? shown_view_ : view_; }

  /// Returns what the picture that is shown is made of.
  [[nodiscard]] const ShownRecipe& shown_recipe() const { return shown_recipe_; }

  /// Returns the picture of the last draw, valid until the next one.
  [[nodiscard]] Result<ShownPicture> shown_picture();

  /// Returns the number of the picture that is shown, as CompletePicture has it. 0: none yet.
  [[nodiscard]] std::uint64_t shown_number() const { return shown_number_; }

  /// Returns the picture of the last draw if only splats are in it: its alpha is the volume's opacity. Must not be
  /// called while `is_drawing`.
  [[nodiscard]] std::optional<DevicePicture> volume_picture() const;

  /// Whether pictures of splats may be drawn by a job.
  [[nodiscard]] bool draws_aside() const { return player_->rasterizer().capabilities().any_thread; }

  /// Returns the device that draws, in words.
  [[nodiscard]] std::string device_text() const { return player_->rasterizer().description(); }

  [[nodiscard]] Result<Image> image() const { return player_->image(); }

  /// Returns the last picture with its outline, if the scene has one, and with words round it. `page`: for a picture of
  /// this size.
  [[nodiscard]] Result<Image> page(const Page& page, const PageText& text, bool transparent = false) const;

  [[nodiscard]] double draw_seconds() const { return draw_seconds_; }

  /// Returns how the picture sharpens. None while something moves.
  [[nodiscard]] const std::optional<ProgressiveRefinement>& refinement() const { return refinement_; }

  [[nodiscard]] StreamerStatistics statistics() const {
    return is_drawing() ? before_.statistics : player_->streamer().statistics();
  }
  [[nodiscard]] std::uint64_t device_bytes() const { return device_bytes_; }
  [[nodiscard]] DrawingUnits units() const { return player_->streamer().units(); }

  /// Returns the errors so far, the newest last. One that comes back with each picture, as of a part that cannot be
  /// read, is told once.
  [[nodiscard]] const std::vector<std::string>& troubles() const { return troubles_; }

  /// As Player::left_out.
  [[nodiscard]] std::optional<Error> left_out() const { return is_drawing() ? before_.left_out : player_->left_out(); }

  Scene scene;  // the scene to draw; width and height are those of the last draw
  ViewSettings settings;
  std::optional<int> up;  // the axis that choose_up chose

  struct Playback {
    double steps_per_second = 5;  // at most
    bool loops = false;           // goes on with the first step after the last
  };
  Playback playback;

 private:
  explicit Session(SessionHost& host) : host_(host) {}
  // What a job does.
  enum class Work { moving, refining, making_ready };

  [[nodiscard]] Status draw_next(int width, int height, double seconds, bool is_busy);
  [[nodiscard]] Status use_step();
  void await_step();
  [[nodiscard]] Status apply();
  [[nodiscard]] Status read_change();
  void end_reading();
  void begin_fitting(std::function<Result<Scene>(const format::Volume&)> fit);
  void end_fitting();
  void take_fitted();
  [[nodiscard]] Status take_change(Result<SessionFile> change, const Scene& without_change);
  void take_back(const Scene& without_change);
  [[nodiscard]] Scene scene_without_change() const;
  [[nodiscard]] Status fit_camera();
  [[nodiscard]] Status draw_aside(Work work, std::function<Status()> draw);
  [[nodiscard]] Status end_drawing(bool is_busy);
  [[nodiscard]] Status finish(const Status& done);
  void interrupt_drawing();
  void stop_drawing();
  void note_drawn(const ShownRecipe& recipe);
  void note_frame();
  void encode(const Image& picture, const View& view, const Scene& shown, EncodedPicture& encoded) const;
  [[nodiscard]] Status encode_picture();
  [[nodiscard]] Status encode_aside();

  // Pictures (session_pictures.cpp).
  [[nodiscard]] Status begin_picture(bool moves, double seconds);
  [[nodiscard]] Status choose_picture();
  [[nodiscard]] Result<Choices> choices_for(bool moves) const;
  [[nodiscard]] Status draw_picture(double seconds);
  [[nodiscard]] Status draw_splats(const Recipe& recipe, double seconds);
  [[nodiscard]] Status finish_picture(const Status& drawn);
  [[nodiscard]] Status finish_moving();
  [[nodiscard]] Status finish_refining();
  void go_on_without_cells();

  // While something moves (session_moving.cpp).
  [[nodiscard]] bool shows_surfaces() const;
  [[nodiscard]] bool has_layers() const { return shows_surfaces() || !player_->view().slices.empty(); }
  void begin_holding_cells();
  void end_holding_cells();
  void keep_last_moving();
  [[nodiscard]] Status learn_errors();

  // At rest (session_rest.cpp).
  void begin_rest(bool with_cells = true);
  void follow_movement(ProgressiveRefinement::Start& start) const;
  [[nodiscard]] bool can_draw_aside() const;
  [[nodiscard]] int quick_spacing() const;
  [[nodiscard]] Quality quality_of_splats() const;
  [[nodiscard]] double most_segments() const;
  [[nodiscard]] int finest_spacing() const;
  [[nodiscard]] int first_exact_spacing() const;
  [[nodiscard]] Status begin_making_ready();
  [[nodiscard]] Status make_ready();
  [[nodiscard]] Status finish_making_ready(const Status& made);
  void tell_of_splats(const std::string& reason);
  void tell_once(const std::string& trouble);
  void settle();

  void restore(const Scene& before);

  SessionHost& host_;
  std::string path_;
  std::vector<std::string> pieces_;
  std::optional<ConvertedFile> converted_;
  Scene first_scene_;
  bool fits_ = false;  // the first scene is one that fits the data, and its camera shall fit the first picture's size
  std::unique_ptr<Player> player_;
  std::optional<std::size_t> asked_step_;  // still to be read
  std::optional<std::size_t> read_ahead_;  // by the player, since the step changed
  bool awaits_step_ = false;               // no picture of the step yet
  bool still_awaits_step_ = false;         // after the last splats were chosen
  double awaited_seconds_ = 0;             // since the step was asked for
  bool picture_is_whole_ = false;          // the rasterizer's: not interrupted

  std::optional<History<Scene>> history_;   // of the scene, without its size; none before a picture
  std::optional<double> step_seconds_;      // while steps play: since the last change
  std::optional<std::size_t> played_step_;  // a file that is read meanwhile

  EncodedPicture encoded_, encoded_aside_;  // shown; by a job
  dvec3 encoded_background_{0};
  bool encoded_outline_ = false;
  bool encoded_is_old_ = true;
  bool encoded_is_shown_ = true;

  std::array<std::uint64_t, 64> histogram_{}, opacity_histogram_{};
  Box bounds_, mesh_box_;
  Scene fitting_scene_;  // fits the attribute that is drawn

  // The settings, scene and view of the last draw.
  ViewSettings used_settings_;
  Scene used_scene_;
  View view_;

  // A change of scene, settings and step whose parts of the file are read.
  struct Reading {
    Scene scene;
    ViewSettings settings;
    std::optional<std::size_t> step;
    std::stop_source stop;
    Task<Result<SessionFile>> file;
  };
  std::optional<Reading> reading_;

  // A camera that is to show all, or colours for what is seen.
  struct Fitting {
    Scene before;
    std::stop_source stop;
    Task<Result<Scene>> fitted;
  };
  std::optional<Fitting> fitting_;
  bool fits_function_ = false;  // the scene's attribute is to get the function that fits it
  bool fits_opacity_ = false;   // the opacity likewise

  bool settled_ = false;
  bool moving_is_drawn_ = false;  // the picture of a movement is that of the present scene, and complete
  Status failure_;                // of the last draw
  double still_seconds_ = 0;      // since the scene changed last

  // The next picture, or the last one. A job may draw it.
  struct Picture {
    bool moves = false;
    Choices choices = {};
    std::optional<Recipe> recipe = {};    // none: the last picture of a view at rest is there
    std::optional<Outcome> outcome = {};  // once it is drawn
    Status cells = {};                    // why they cannot be drawn
  };
  Picture picture_;
  bool cells_fail_ = false;  // since the last change of the file's parts

  // While something moves.
  MotionControl motion_;
  std::stop_source stop_holding_;
  Task<Status> holding_cells_;  // reads them; beside all else
  struct LastMoving {
    Image picture;
    Recipe recipe;
  };
  std::optional<LastMoving> last_moving_;  // of splats, until the picture at rest tells its error

  // At rest.
  std::optional<ProgressiveRefinement> refinement_;
  bool is_to_make_ready_ = false;  // for what moves, and for probes; after the last picture
  std::vector<std::string> troubles_;
  std::unordered_set<std::string> told_once_;  // of them

  // Of the last picture.
  std::uint64_t shown_number_ = 0;
  View shown_view_;
  ShownRecipe shown_recipe_;
  double took_seconds_ = 0;  // of drawing; also by a job, until it ends
  double job_seconds_ = 0;   // of the last job; by it, until it ends
  double draw_seconds_ = 0;
  std::uint64_t device_bytes_ = 0;

  // A picture by a job. Until it ends, nothing else changes the player.
  Work work_ = Work::moving;
  std::stop_source stop_;
  Task<Status> drawing_;

  // What is told meanwhile.
  struct Before {
    std::optional<FrameSplats> frame;
    std::optional<ExactPicture> exact;
    std::vector<DrawnNode> nodes;
    StreamerStatistics statistics;
    bool is_reading_ahead = false;
    std::optional<Error> left_out;
  };
  Before before_;
};

}  // namespace splatvol
