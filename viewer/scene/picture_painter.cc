// The thread that draws pictures in full detail, with an OpenGL context of its own.
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#include <vtkCamera.h>
#include <vtkGenericOpenGLRenderWindow.h>
#include <vtkMatrix4x4.h>
#include <vtkNew.h>
#include <vtkOpenGLFramebufferObject.h>
#include <vtkOpenGLState.h>
#include <vtkPolyDataMapper.h>
#include <vtkProperty.h>
#include <vtkRenderer.h>

#include <QOffscreenSurface>
#include <QOpenGLContext>
#include <QOpenGLFunctions>
#include <QThread>
#include <condition_variable>
#include <map>
#include <mutex>
#include <optional>
#include <string>

#include "viewer/scene/full_picture.h"
#include "viewer/scene/scene_look.h"

namespace gnathion {
namespace {

constexpr int kNice = 5;  ///< after the window, before its jobs

bool drawn_by_processor(QOpenGLContext& context) {
  const auto* name = reinterpret_cast<const char*>(context.functions()->glGetString(GL_RENDERER));
  const std::string renderer = name ? name : "";
  for (const char* driver : {"llvmpipe", "softpipe", "swrast"})
    if (renderer.find(driver) != std::string::npos) return true;
  return false;
}

/// VTK's side of the thread: made, used and taken apart on it.
class Studio {
 public:
  explicit Studio(std::function<void()> make_current) {
    make_current();
    window_->SetMultiSamples(0);
    window_->SetIsCurrent(true);  // no other context comes to this thread
    window_->SetSupportsOpenGL(1);
    window_->SetIsDirect(1);
    window_->SetMapped(1);
    window_->SetFrameBlitModeToNoBlit();
    window_->AddRenderer(renderer_);
    set_background(*renderer_);
    add_lights(*renderer_);
    renderer_->SetUseFXAA(true);
  }
  ~Studio() { window_->Finalize(); }

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
    vtkOpenGLFramebufferObject* drawn = window_->GetRenderFramebuffer();
    window_->GetState()->PushReadFramebufferBinding();
    drawn->Bind(GL_READ_FRAMEBUFFER);
    drawn->ActivateReadBuffer(0);
    QOpenGLFunctions* gl = QOpenGLContext::currentContext()->functions();
    gl->glPixelStorei(GL_PACK_ALIGNMENT, 1);
    gl->glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, out.rgba.data());
    gl->glReadPixels(0, 0, width, height, GL_DEPTH_COMPONENT, GL_FLOAT, out.depth.data());
    window_->GetState()->PopReadFramebufferBinding();
  }

  vtkNew<vtkGenericOpenGLRenderWindow> window_;
  vtkNew<vtkRenderer> renderer_;
  std::map<Key, Ready> ready_;
};

}  // namespace

class PicturePainter::Thread : public QThread {
 public:
  Thread(std::unique_ptr<QOpenGLContext> context, QOffscreenSurface* surface,
         std::function<void(std::shared_ptr<const FinishedPicture>)> finished)
      : context_(std::move(context)), surface_(surface), finished_(std::move(finished)) {
    context_->moveToThread(this);
  }
  ~Thread() override {
    {
      const std::lock_guard lock(mutex_);
      ended_ = true;
    }
    asked_.notify_one();
    wait();
  }
  void ask(PictureRequest request) {
    {
      const std::lock_guard lock(mutex_);
      next_ = std::move(request);
    }
    asked_.notify_one();
  }

 protected:
  void run() override {
    ::setpriority(PRIO_PROCESS, static_cast<id_t>(::syscall(SYS_gettid)), kNice);
    if (context_->makeCurrent(surface_)) draw_all();
    context_->doneCurrent();
    context_.reset();  // on the thread that it lives in
  }

 private:
  void draw_all() {
    Studio studio([this] { context_->makeCurrent(surface_); });
    for (;;) {
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

  std::unique_ptr<QOpenGLContext> context_;
  QOffscreenSurface* surface_;
  std::function<void(std::shared_ptr<const FinishedPicture>)> finished_;
  std::mutex mutex_;
  std::condition_variable asked_;
  std::optional<PictureRequest> next_;
  bool ended_ = false;
};

std::unique_ptr<PicturePainter> PicturePainter::make_for_processor(
    std::function<void(std::shared_ptr<const FinishedPicture>)> done) {
  auto surface = std::make_unique<QOffscreenSurface>();
  surface->setFormat(QSurfaceFormat::defaultFormat());
  surface->create();
  auto context = std::make_unique<QOpenGLContext>();
  context->setFormat(QSurfaceFormat::defaultFormat());
  if (!surface->isValid() || !context->create() || !context->makeCurrent(surface.get())) return nullptr;
  const bool wanted = drawn_by_processor(*context);
  context->doneCurrent();
  if (!wanted) return nullptr;
  std::unique_ptr<PicturePainter> painter(new PicturePainter);
  painter->gui_ = std::make_unique<QObject>();
  const auto post = [gui = painter->gui_.get(), done](std::shared_ptr<const FinishedPicture> picture) {
    QMetaObject::invokeMethod(
        gui, [done, picture] { done(picture); }, Qt::QueuedConnection);
  };
  painter->thread_ = std::make_unique<Thread>(std::move(context), surface.get(), post);
  painter->surface_ = std::move(surface);
  painter->thread_->start();
  return painter;
}

PicturePainter::~PicturePainter() {
  thread_.reset();  // before what it draws on, and before whom it tells
}

void PicturePainter::draw(PictureRequest request) {
  thread_->ask(std::move(request));
}

}  // namespace gnathion
