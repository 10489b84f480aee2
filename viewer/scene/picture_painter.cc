// The thread that draws pictures in full detail. Its window is VTK's own, off the screen: with a connection
// of its own to the display, it has its own drawing threads too. A context of Qt's would share them with the
// window, which then waits for each picture after all.
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vtkActorCollection.h>
#include <vtkCamera.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkOpenGLRenderWindow.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderWindow.h>
#include <vtkRenderer.h>
#include <vtkUnsignedCharArray.h>

#include <QGuiApplication>
#include <algorithm>
#include <condition_variable>
#include <future>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "viewer/scene/full_picture.h"
#include "viewer/scene/scene_look.h"

namespace gnathion {
namespace {

constexpr int kNice = 5;  ///< after the window, before its jobs

/// VTK's side of the thread: made, used and taken apart on it.
class Studio {
 public:
  Studio() : window_(vtkOpenGLRenderWindow::SafeDownCast(any_)) {
    any_->SetOffScreenRendering(1);
    any_->SetMultiSamples(0);
    any_->AddRenderer(renderer_);
    set_background(*renderer_);
    add_lights(*renderer_);
    renderer_->SetUseFXAA(true);
  }

  bool drawn_by_processor() {
    if (!window_) return false;
    window_->SetSize(8, 8);
    window_->Render();
    const char* told = window_->ReportCapabilities();
    const std::string capabilities = told ? told : "";
    for (const char* driver : {"llvmpipe", "softpipe", "swrast"})
      if (capabilities.find(driver) != std::string::npos) return true;
    return false;
  }

  std::shared_ptr<const FinishedPicture> draw(const PictureRequest& r) {
    put_surfaces(r);
    vtkCamera* camera = renderer_->GetActiveCamera();
    camera->SetPosition(r.camera.eye.data());
    camera->SetFocalPoint(r.camera.focus.data());
    camera->SetViewUp(r.camera.up.data());
    camera->SetViewAngle(r.camera.angle_deg);
    camera->SetClippingRange(r.clipping_mm[0], r.clipping_mm[1]);
    window_->SetSize(r.px.width(), r.px.height());
    window_->Render();
    auto out = std::make_shared<FinishedPicture>();
    out->version = r.version;
    out->camera = r.camera;
    out->clipping_mm = r.clipping_mm;
    out->px = r.px;
    read_back(*out);
    if (r.marks_inside && renderer_->GetUseDepthPeeling()) read_depth_of_clear(*out);
    return out;
  }

 private:
  using Key = std::pair<const PreparedSurface*, const VertexColors*>;
  struct Ready {
    std::shared_ptr<const PreparedSurface> surface;  // keep what the key points to
    std::shared_ptr<const VertexColors> colors;
    vtkSmartPointer<vtkPolyDataMapper> mapper;
  };

  void put_surfaces(const PictureRequest& r) {
    renderer_->RemoveAllViewProps();
    std::map<Key, Ready> kept;
    bool clear = false;
    for (const PictureRequest::Surface& s : r.surfaces) {
      const Key key(s.surface.get(), s.colors.get());
      if (!kept.count(key)) kept[key] = ready_.count(key) ? ready_[key] : made_ready(s);
      vtkNew<vtkActor> actor;
      actor->SetMapper(kept[key].mapper);
      set_look(*actor->GetProperty(), s.colors != nullptr, s.color, s.opacity);
      vtkNew<vtkMatrix4x4> pose;
      for (int row = 0; row < 4; ++row)
        for (int column = 0; column < 4; ++column) pose->SetElement(row, column, s.pose(row, column));
      actor->SetUserMatrix(pose);
      renderer_->AddActor(actor);
      clear |= s.opacity < 1.0;
    }
    renderer_->SetUseDepthPeeling(clear);
    ready_ = std::move(kept);  // what is no longer shown goes
  }

  static Ready made_ready(const PictureRequest::Surface& s) {
    auto data = vtkSmartPointer<vtkPolyData>::New();
    data->ShallowCopy(s.surface->full);  // another view may draw the same surface at the same time
    if (s.colors) data = with_colors(data, *s.colors, nullptr);
    return {s.surface, s.colors, mapper_of(data, s.colors != nullptr)};
  }

  void read_back(FinishedPicture& out) {
    const int width = out.px.width(), height = out.px.height();
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    out.rgba.resize(4 * pixels);
    out.depth.resize(pixels);
    constexpr int kBack = 0;
    window_->GetRGBACharPixelData(0, 0, width - 1, height - 1, kBack, colors_);
    window_->GetZbufferData(0, 0, width - 1, height - 1, out.depth.data());
    std::copy_n(colors_->GetPointer(0), out.rgba.size(), out.rgba.begin());
  }

  /// What is clear leaves no depth; marks inside or behind it would lie over it. The same surfaces once more,
  /// as if they were opaque, those apart that hide little.
  void read_depth_of_clear(FinishedPicture& out) {
    constexpr double kHides = 0.5;
    renderer_->SetUseDepthPeeling(false);
    vtkActorCollection* actors = renderer_->GetActors();
    actors->InitTraversal();
    while (vtkActor* actor = actors->GetNextActor()) {
      actor->SetVisibility(actor->GetProperty()->GetOpacity() >= kHides);
      actor->GetProperty()->SetOpacity(1);
    }
    window_->Render();
    window_->GetZbufferData(0, 0, out.px.width() - 1, out.px.height() - 1, out.depth.data());
  }

  vtkNew<vtkUnsignedCharArray> colors_;
  vtkNew<vtkRenderWindow> any_;
  vtkOpenGLRenderWindow* window_;
  vtkNew<vtkRenderer> renderer_;
  std::map<Key, Ready> ready_;
};

}  // namespace

class PicturePainter::Thread {
 public:
  using Finished = std::function<void(std::shared_ptr<const FinishedPicture>)>;
  explicit Thread(Finished finished) : finished_(std::move(finished)) {}
  ~Thread() {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    asked_.notify_one();
    if (thread_.joinable()) thread_.join();
  }
  /// Waits until the thread is ready to draw: what OpenGL's functions are is found once a process, by no two
  /// threads at a time. False: it is not wanted.
  bool start() {
    auto ready = std::make_shared<std::promise<bool>>();
    thread_ = std::thread([this, ready] { run(*ready); });
    return ready->get_future().get();
  }
  void ask(PictureRequest request) {
    {
      const std::lock_guard lock(mutex_);
      next_ = std::move(request);
    }
    asked_.notify_one();
  }

 private:
  void run(std::promise<bool>& ready) {
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), kNice);
    Studio studio;
    const bool wanted = studio.drawn_by_processor();
    ready.set_value(wanted);
    while (wanted) {
      std::optional<PictureRequest> request;
      {
        std::unique_lock lock(mutex_);
        asked_.wait(lock, [this] { return ended_ || next_; });
        if (ended_) return;
        request.swap(next_);
      }
      finished_(studio.draw(*request));
    }
  }

  Finished finished_;
  std::thread thread_;
  std::mutex mutex_;
  std::condition_variable asked_;
  std::optional<PictureRequest> next_;
  bool ended_ = false;
};

std::unique_ptr<PicturePainter> PicturePainter::make_for_processor(Thread::Finished done) {
  // Without an X server VTK has no window of its own here.
  if (QGuiApplication::platformName() != "xcb") return nullptr;
  std::unique_ptr<PicturePainter> painter(new PicturePainter);
  painter->gui_ = std::make_unique<QObject>();
  const auto post = [gui = painter->gui_.get(), done](std::shared_ptr<const FinishedPicture> picture) {
    QMetaObject::invokeMethod(
        gui, [done, picture] { done(picture); }, Qt::QueuedConnection);
  };
  painter->thread_ = std::make_unique<Thread>(post);
  return painter->thread_->start() ? std::move(painter) : nullptr;
}

PicturePainter::~PicturePainter() {
  thread_.reset();  // before whom it tells
}

void PicturePainter::draw(PictureRequest request) {
  thread_->ask(std::move(request));
}

}  // namespace gnathion
