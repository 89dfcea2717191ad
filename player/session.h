// A file that somebody looks at. Decides how fine a picture there is time for.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <utility>
#include <vector>

#include "base/addresses.h"
#include "base/error.h"
#include "format/steps.h"
#include "format/volume.h"
#include "pictures/page.h"
#include "player/change_reader.h"
#include "player/conversion.h"
#include "player/history.h"
#include "player/motion_control.h"
#include "player/picture_job.h"
#include "player/player.h"
#include "player/playing.h"
#include "player/progressive_refinement.h"
#include "player/recipe.h"
#include "player/screen_picture.h"
#include "player/session_file.h"
#include "player/session_host.h"
#include "player/streamline_job.h"
#include "player/troubles.h"
#include "renderer/rasterizer.h"
#include "scene/scene.h"
#include "streamer/first/default_scene.h"

namespace splatvol {

/// After this time without a change, in seconds, the picture becomes finer.
inline constexpr double pause_seconds = 0.15;

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

  /// Whether a job draws a picture: calls of `draw` do not wait for it long. Then `image` must not be called;
  /// `shown_picture` is the one before.
  [[nodiscard]] bool is_drawing() const { return job_.is_begun(); }

  /// Whether it is still at work.
  [[nodiscard]] bool awaits_picture() const { return is_drawing() && !job_.wait(); }

  /// Whether a job reads what a change needs: another attribute, kernel, memory or step, or surfaces. Until it is
  /// there, pictures are drawn without the change.
  [[nodiscard]] bool is_reading() const { return change_.is_begun(); }

  /// Takes back the change that is_reading() tells of, or that of is_fitting().
  void cancel_reading();

  /// Returns whether another call without a change would draw the same.
  [[nodiscard]] bool is_settled() const {
    return progress_.settled && !is_reading() && !change_.step && !is_fitting() && !is_following();
  }

  /// Whether a job follows streamlines of the scene. Tubes of those that are there are drawn.
  [[nodiscard]] bool is_following() const { return streamlines_.is_begun(); }

  /// A count of streamlines, and of seeds; seeds outside of the field have none.
  struct StreamlineCount {
    std::size_t lines = 0, seeds = 0;
  };
  /// Returns them for each of the scene's streamlines, as far as they are followed.
  [[nodiscard]] const std::vector<StreamlineCount>& streamline_counts() const { return streamline_counts_; }

  /// Returns the transfer function that fits the attribute that is drawn, on the background of `scene`.
  [[nodiscard]] TransferFunction fitting_function() const;

  /// Gives the scene a camera that sees all that the file shows, in the size of the last picture, with `up_axis`
  /// upwards. Coarse splats are read for it, by a job where changes are read aside. A camera that moves meanwhile
  /// stays.
  void show_all();

  /// Spreads the colours over the values that are seen (streamer/first/default_scene.h), likewise.
  void show_visible();
  [[nodiscard]] bool is_fitting() const { return fitting_.fitted.is_begun(); }

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
  [[nodiscard]] std::size_t step() const { return change_.step.value_or(player_->step()); }

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
  void stop_playing() { playback.end(); }
  [[nodiscard]] bool is_playing() const { return playback.is_begun(); }

  /// Shows the next step once the picture of this one is there, its time has passed and the next one has been read. If
  /// a file cannot be read, or that is taken back, it is the end. `seconds`: since the last call.
  [[nodiscard]] Status play(double seconds);

  /// Adds the scene to those that it went through, if it has changed and there is a picture.
  void remember();

  /// Go to the scene before, or to the one that was undone last.
  void undo();
  void redo();
  [[nodiscard]] bool can_undo() const { return history_ && history_->can_undo(); }
  [[nodiscard]] bool can_redo() const { return history_ && history_->can_redo(); }

  /// Whether the picture is that of `step()`, and so fine.
  [[nodiscard]] bool is_step_shown() const { return !awaited_.is_awaited && !change_.step; }

  /// Begins to read another step of a series. Does nothing if there is no such step.
  void read_ahead(std::size_t step) {
    if (is_drawing()) return;
    player_->read_ahead(step, first_exact_spacing() > 0);
    awaited_.ahead = step;
  }

  /// Whether `show_step` would wait for what `read_ahead` reads.
  [[nodiscard]] bool is_reading_ahead() const {
    return is_drawing() ? job_.last().is_reading_ahead : player_->is_reading_ahead();
  }

  /// Returns the range of the shown attribute's values over all steps.
  [[nodiscard]] format::StepRange range_of_all_steps() const {
    return player_->steps().range_of(used_.scene.attribute);
  }

  /// Returns why the picture shows nothing, or only one colour; empty if it does show something.
  [[nodiscard]] std::string explain() const;

  [[nodiscard]] const format::VolumeInfo& info() const { return player_->info(); }
  /// Returns the attribute that is drawn, with the unit that the scene tells.
  [[nodiscard]] format::Attribute attribute() const;

  /// Returns the scalar bars of the picture (bar_colors_of).
  [[nodiscard]] std::vector<PageBar> scalar_bars() const;

  /// Returns the opacity attribute of the picture, if there is one.
  [[nodiscard]] std::optional<format::Attribute> opacity_attribute() const;
  [[nodiscard]] const std::array<std::uint64_t, 64>& histogram() const { return data_.histogram; }
  [[nodiscard]] const std::array<std::uint64_t, 64>& opacity_histogram() const { return data_.opacity_histogram; }
  [[nodiscard]] const std::string& path() const { return source_.path; }

  /// Returns the file that a mesh became, if it is one.
  [[nodiscard]] const std::optional<ConvertedFile>& converted() const { return source_.converted; }

  /// Removes that file from the cache. It stays open, and is none that a mesh became any more.
  [[nodiscard]] Status forget_converted();
  [[nodiscard]] std::uint64_t file_bytes() const { return player_->streamer().volume().file_bytes(); }
  [[nodiscard]] const Scene& first_scene() const { return first_scene_; }

  /// Returns the scene with what is needed to show the same elsewhere: file, step, detail and kernel.
  [[nodiscard]] UsedScene used_scene() const;

  /// Takes over what a scene tells of its use, besides its file.
  [[nodiscard]] Status use(const SceneUse& use);

  /// Returns the scene of the last draw. It lacks what is being read.
  [[nodiscard]] const Scene& drawn_scene() const { return used_.scene; }

  /// Returns a box round the material of the coarsest splats.
  [[nodiscard]] const Box& bounds() const { return data_.bounds; }

  /// Returns the box round the mesh's cells; as bounds() if the file keeps none.
  [[nodiscard]] const Box& mesh_box() const { return data_.mesh_box; }

  /// Returns the splats of the last draw; while `is_drawing`, those of the draw before, without their list. Null before
  /// the first.
  [[nodiscard]] const FrameSplats* frame() const {
    if (!is_drawing()) return player_->frame();
    return job_.last().frame ? &*job_.last().frame : nullptr;
  }

  /// Returns what is known of the last picture if it is exact; else nothing.
  [[nodiscard]] const std::optional<ExactPicture>& exact() const {
    return is_drawing() ? job_.last().exact : player_->exact();
  }
  [[nodiscard]] std::vector<DrawnNode> drawn_nodes() const {
    return is_drawing() ? job_.last().nodes : player_->streamer().drawn_nodes();
  }

  /// Returns the view of the picture that is shown, in the size of the window's picture.
  [[nodiscard]] const View& view() const { return shown_.number > 0 ? shown_.view : used_.view; }

  /// Returns what the picture that is shown is made of.
  [[nodiscard]] const ShownRecipe& shown_recipe() const { return shown_.recipe; }

  /// Returns the picture of the last draw, valid until the next one.
  [[nodiscard]] Result<ShownPicture> shown_picture();

  /// Returns the number of the picture that is shown, as CompletePicture has it. 0: none yet.
  [[nodiscard]] std::uint64_t shown_number() const { return shown_.number; }

  /// Returns the picture of the last draw if only splats are in it: its alpha is the volume's opacity. Must not be
  /// called while `is_drawing`.
  [[nodiscard]] std::optional<DevicePicture> volume_picture() const;

  /// Whether pictures of splats may be drawn by a job.
  [[nodiscard]] bool draws_aside() const { return player_->rasterizer().capabilities().any_thread; }

  /// Returns the scene's surfaces with their triangles.
  [[nodiscard]] const std::vector<Surface>& surfaces() const {
    return is_drawing() ? job_.last().surfaces : player_->surfaces();
  }

  /// Returns the cells that picks in the scene of the last draw ask. None: the file keeps none, some are of a kind that
  /// is not known, they cannot be read, or a server would be asked. Then splats answer.
  [[nodiscard]] std::optional<SharedCells> cells_for_picks() const {
    return is_drawing() ? job_.last().cells : player_->cells_for_picks();
  }

  /// Returns the function by which splats are drawn: with shells in place of contours.
  [[nodiscard]] const TransferFunction& function_of_splats() const { return player_->function_of_splats(); }

  /// Returns the device that draws, in words.
  [[nodiscard]] std::string device_text() const { return player_->rasterizer().description(); }

  [[nodiscard]] Result<Image> image() const { return player_->image(); }

  [[nodiscard]] double draw_seconds() const { return shown_.seconds; }

  /// Returns how the picture sharpens. None while something moves.
  [[nodiscard]] const std::optional<ProgressiveRefinement>& refinement() const { return rest_.refinement; }

  [[nodiscard]] StreamerStatistics statistics() const {
    return is_drawing() ? job_.last().statistics : player_->streamer().statistics();
  }
  [[nodiscard]] std::uint64_t device_bytes() const { return shown_.device_bytes; }
  [[nodiscard]] DrawingUnits units() const { return player_->streamer().units(); }

  /// Returns the errors so far, the newest last. One that comes back with each picture, as of a part that cannot be
  /// read, is told once.
  [[nodiscard]] const std::vector<std::string>& troubles() const { return troubles_.all(); }

  /// As Player::left_out.
  [[nodiscard]] std::optional<Error> left_out() const {
    return is_drawing() ? job_.last().left_out : player_->left_out();
  }

  Scene scene;  // the scene to draw; width and height are those of the last draw
  ViewSettings settings;
  std::optional<int> up;  // the axis that choose_up chose

  Playing playback;

 private:
  using Work = PictureJob::Work;

  explicit Session(SessionHost& host) : host_(host) {}

  [[nodiscard]] Status draw_next(int width, int height, double seconds, bool is_busy);
  [[nodiscard]] Status use_step();
  void await_step();
  [[nodiscard]] bool reads_steps_here() const;
  [[nodiscard]] Status apply();
  [[nodiscard]] Status read_change();
  [[nodiscard]] bool take_tubes();
  void begin_fitting(std::function<Result<Scene>(const format::Volume&)> fit);
  void take_fitted();
  [[nodiscard]] Status take_change(Result<SessionFile> change, const Scene& without_change);
  void take_back(const Scene& without_change);
  [[nodiscard]] Scene scene_without_change() const;
  [[nodiscard]] Status fit_camera();
  [[nodiscard]] Status draw_aside(Work work, std::function<Status()> draw);
  [[nodiscard]] Status end_drawing(bool is_busy);
  void interrupt_drawing();
  void stop_drawing();
  void note_drawn(const ShownRecipe& recipe);
  void note_frame();
  [[nodiscard]] Status encode_picture();
  void encode_aside();

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
  [[nodiscard]] MotionLimits moving_limits(bool is_busy) const;
  void begin_holding_cells();
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
  void settle();

  void restore(const Scene& before);

  SessionHost& host_;
  SessionSource source_;
  Scene first_scene_;
  bool fits_ = false;  // the first scene is one that fits the data, and its camera shall fit the first picture's size
  std::unique_ptr<Player> player_;
  SessionData data_;
  ChangeReader change_;
  StreamlineJob streamlines_;
  std::vector<StreamlineCount> streamline_counts_;
  std::optional<History<Scene>> history_;  // of the scene, without its size; none before a picture
  Troubles troubles_;

  // A camera that is to show all, or colours for what is seen.
  struct Fitting {
    Scene before = {};
    Task<Result<Scene>> fitted = {};
  };
  Fitting fitting_;

  // A step that has been asked for.
  struct AwaitedStep {
    bool is_awaited = false;                // no picture of it yet
    bool is_awaited_after = false;          // the picture that is being drawn
    double seconds = 0;                     // since it was asked for
    std::optional<std::size_t> ahead = {};  // what the player reads ahead, since the step changed
  };
  AwaitedStep awaited_;

  // What the last draw had.
  struct Used {
    ViewSettings settings = {};
    Scene scene = {};
    View view = {};
  };
  Used used_;

  // How far the picture is.
  struct Progress {
    bool settled = false;
    Status failure = {};       // of the last draw
    double still_seconds = 0;  // since the scene changed last
  };
  Progress progress_;

  // The next picture, or the last one. A job may draw it.
  struct Picture {
    bool moves = false;
    Choices choices = {};
    std::optional<Recipe> recipe = {};    // none: the last picture of a view at rest is there
    std::optional<Outcome> outcome = {};  // once it is drawn
    Status cells = {};                    // why they cannot be drawn
    double seconds = 0;                   // of drawing
  };
  Picture picture_;
  bool cells_fail_ = false;  // since the last change of the file's parts

  // While something moves.
  struct Movement {
    MotionControl control;
    bool is_drawn = false;            // its picture is that of the present scene, and complete
    Task<Status> holding_cells = {};  // reads them; beside all else

    struct Last {
      Image picture;
      Recipe recipe;
    };
    std::optional<Last> last = {};  // picture of splats, until the one at rest tells its error
  };
  Movement movement_;

  struct Rest {
    std::optional<ProgressiveRefinement> refinement = {};
    bool is_to_make_ready = false;  // for what moves, and for picks; after the last picture
  };
  Rest rest_;

  // Of the last picture.
  struct Shown {
    std::uint64_t number = 0;
    View view = {};
    ShownRecipe recipe = {};
    double seconds = 0;  // of drawing
    std::uint64_t device_bytes = 0;
    bool is_whole = false;  // not interrupted, and the rasterizer's
  };
  Shown shown_;
  ScreenPicture screen_;
  PictureJob job_;
};

}  // namespace splatvol
