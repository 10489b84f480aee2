// A camera's picture with the outlines of the tags that were found in it.
#pragma once

#include <QImage>
#include <QWidget>

#include "client/daemon_client.h"

namespace gnathion {

class CameraView : public QWidget {
 public:
  explicit CameraView(QWidget* parent = nullptr);
  void show_preview(const client::Preview& preview);
  std::size_t tags() const { return preview_.tags.size(); }  ///< outlines in the picture that shows
  const QString& facts() const { return facts_; }
  void set_facts(const QString& line);  ///< rate, drops, latency

 protected:
  void paintEvent(QPaintEvent* event) override;

 private:
  client::Preview preview_;
  QImage picture_;
  QString facts_;
};

}  // namespace gnathion
