"""One small file of each calibration format, as the tool that owns the format writes it. Every one
holds a baseline of 0.1 m.
"""

ROS_LEFT = """image_width: 1280
image_height: 1024
camera_name: narrow_stereo/left
camera_matrix:
  rows: 3
  cols: 3
  data: [1000, 0, 640, 0, 1000, 512, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.2, 0.05, 0, 0, 0]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [980, 0, 640, 0, 0, 980, 512, 0, 0, 0, 1, 0]
"""
ROS_RIGHT = ROS_LEFT.replace("/left", "/right").replace("[980, 0, 640, 0,", "[980, 0, 640, -98,")

KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.27, 0.06, 0.0008, 0.0001]
  distortion_model: radtan
  intrinsics: [461.6, 460.3, 362.6, 248.1]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
cam1:
  T_cn_cnm1:
  - [1.0, 0.0, 0.0, -0.1]
  - [0.0, 1.0, 0.0, 0.0]
  - [0.0, 0.0, 1.0, 0.0]
  - [0.0, 0.0, 0.0, 1.0]
  cam_overlaps: [0]
  camera_model: pinhole
  distortion_coeffs: [-0.28, 0.07, 0.0002, 1.0e-05]
  distortion_model: radtan
  intrinsics: [457.6, 456.1, 379.9, 255.2]
  resolution: [752, 480]
  rostopic: /cam1/image_raw
"""

OPENCV_INTRINSICS = """%YAML:1.0
---
M1: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 533., 0., 342., 0., 533., 234., 0., 0., 1. ]
D1: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ -2.8e-01, 2.5e-02, 1.2e-03, -1.3e-04, 1.6e-01 ]
M2: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 537., 0., 327., 0., 537., 250., 0., 0., 1. ]
D2: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[ -2.9e-01, 1.0e-01, -5.5e-04, 1.4e-04, -7e-3 ]
"""
OPENCV_EXTRINSICS = """%YAML:1.0
---
R: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
T: !!opencv-matrix
   rows: 3
   cols: 1
   dt: d
   data: [ -0.1, 0., 0. ]
"""
OPENCV = (
    OPENCV_INTRINSICS
    + OPENCV_EXTRINSICS.split("---\n")[1]
    + "image_width: 640\nimage_height: 480\n"
)

OPENCV_XML = """<?xml version="1.0"?>
<opencv_storage>
<image_size>640 480</image_size>
<K1 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>
    533. 0. 342. 0. 533. 234. 0. 0. 1.</data></K1>
<D1 type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt><data>-0.28 0.02 0. 0. 0.</data></D1>
<K2 type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>
    533. 0. 342. 0. 533. 234. 0. 0. 1.</data></K2>
<D2 type_id="opencv-matrix"><rows>1</rows><cols>5</cols><dt>d</dt><data>-0.28 0.02 0. 0. 0.</data></D2>
<R type_id="opencv-matrix"><rows>3</rows><cols>3</cols><dt>d</dt><data>1. 0. 0. 0. 1. 0. 0. 0. 1.</data></R>
<T type_id="opencv-matrix"><rows>3</rows><cols>1</cols><dt>d</dt><data>-0.1 0. 0.</data></T>
</opencv_storage>
"""  # noqa: E501

OPENCV_JSON = """{
    "imageSize": [640, 480],
    "cameraMatrix1": {"type_id": "opencv-matrix", "rows": 3, "cols": 3, "data": [533.0, 0, 342.0, 0, 533.0, 234.0, 0, 0, 1]},
    "distCoeffs1": {"type_id": "opencv-matrix", "rows": 1, "cols": 5, "dt": "d", "data": [-0.28, 0.02, 0, 0, 0]},
    "cameraMatrix2": [[533.0, 0, 342.0], [0, 533.0, 234.0], [0, 0, 1]],
    "distCoeffs2": [[-0.28, 0.02, 0, 0, 0]],
    "R": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "T": [[-0.1], [0], [0]]
}
"""  # noqa: E501

_OPLAB_CAMERA = """   image_width: 2464
   image_height: 2056
   camera_name: LC
   camera_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 2500., 0., 1230., 0., 2500., 1030., 0., 0., 1. ]
   distortion_model: plumb_bob
   distortion_coefficients: !!opencv-matrix
      rows: 1
      cols: 5
      dt: d
      data: [ 0.2, 0.4, 0., 0., 0.1, 0.3, 0.2, 0.1 ]
   rectification_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
   projection_matrix: !!opencv-matrix
      rows: 3
      cols: 4
      dt: d
      data: [ 2400., 0., 1230., 0., 0., 2400., 1030., 0., 0., 0., 1., 0. ]
"""
OPLAB = f"""%YAML:1.0
left:
{_OPLAB_CAMERA}right:
{_OPLAB_CAMERA}extrinsics:
   rotation_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 1., 0., 0., 0., 1., 0., 0., 0., 1. ]
   translation_vector: !!opencv-matrix
      rows: 3
      cols: 1
      dt: d
      data: [ -0.1, 0., 0. ]
   fundamental_matrix: !!opencv-matrix
      rows: 3
      cols: 3
      dt: d
      data: [ 0.000000, 0.000000, 0.000000, 0.000000, 0.000000, 0.000008, 0.000000, -0.000008, 1.000000 ]
date: "2023-01-01"
number_of_images: "50"
avg_reprojection_error: "0.5"
"""  # noqa: E501

ORBSLAM_OLD = """%YAML:1.0

Camera.fx: 435.2046959714599
Camera.fy: 435.2046959714599
Camera.cx: 367.4517211914062
Camera.cy: 252.2008514404297
Camera.k1: 0.0
Camera.width: 752
Camera.height: 480
Camera.bf: 43.52046959714599
LEFT.height: 480
LEFT.width: 752
LEFT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.0]
LEFT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0]
LEFT.R:  !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
LEFT.P:  !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [435.2046959714599, 0, 367.4517211914062, 0,  0, 435.2046959714599, 252.2008514404297, 0,  0, 0, 1, 0]
RIGHT.height: 480
RIGHT.width: 752
RIGHT.D: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data:[-0.28368365, 0.07451284, -0.00010473, -3.555907e-05, 0.0]
RIGHT.K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [457.587, 0.0, 379.999, 0.0, 456.134, 255.238, 0.0, 0.0, 1]
RIGHT.R:  !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
RIGHT.P:  !!opencv-matrix
   rows: 3
   cols: 4
   dt: d
   data: [435.2046959714599, 0, 367.4517211914062, -43.52046959714599, 0, 435.2046959714599, 252.2008514404297, 0, 0, 0, 1, 0]
"""  # noqa: E501

ORBSLAM_NEW = """%YAML:1.0
File.version: "1.0"
Camera.type: "PinHole"
Camera1.fx: 458.654
Camera1.fy: 457.296
Camera1.cx: 367.215
Camera1.cy: 248.375
Camera1.k1: -0.28340811
Camera1.k2: 0.07395907
Camera1.p1: 0.00019359
Camera1.p2: 1.76187114e-05
Camera2.fx: 457.587
Camera2.fy: 456.134
Camera2.cx: 379.999
Camera2.cy: 255.238
Camera2.k1: -0.28368365
Camera2.k2: 0.07451284
Camera2.p1: -0.00010473
Camera2.p2: -3.55590700e-05
Camera.width: 752
Camera.height: 480
Camera.fps: 20
Stereo.ThDepth: 60.0
Stereo.T_c1_c2: !!opencv-matrix
  rows: 4
  cols: 4
  dt: f
  data: [1, 0, 0, 0.1,
         0, 1, 0, 0,
         0, 0, 1, 0,
         0, 0, 0, 1.000000000]
"""

ORBSLAM_RECTIFIED = """%YAML:1.0
File.version: "1.0"
Camera.type: "Rectified"
Camera1.fx: 718.856
Camera1.fy: 718.856
Camera1.cx: 607.1928
Camera1.cy: 185.2157
Stereo.b: 0.1
Camera.width: 1241
Camera.height: 376
"""

MIDDLEBURY = """cam0=[3997.684 0 1176.728; 0 3997.684 1011.728; 0 0 1]
cam1=[3997.684 0 1307.839; 0 3997.684 1011.728; 0 0 1]
doffs=131.111
baseline=100
width=2964
height=1988
ndisp=280
isint=0
vmin=31
vmax=257
"""

NATIVE = """format: stereo-seecolor/rig
version: 1
medium: water
left:
  model: pinhole
  image_size: [640, 480]
  K: [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]
  distortion: [-0.1, 0.01, 0.0, 0.0, 0.0]
right:
  model: pinhole
  image_size: [640, 480]
  K: [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], [0.0, 0.0, 1.0]]
  distortion: [-0.1, 0.01, 0.0, 0.0, 0.0]
T_right_left: [[1.0, 0.0, 0.0, -0.1], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]]
"""  # noqa: E501

WHOLE_RIGS = {
    "native": NATIVE,
    "kalibr": KALIBR,
    "opencv": OPENCV,
    "opencv_xml": OPENCV_XML,
    "opencv_json": OPENCV_JSON,
    "oplab": OPLAB,
    "orbslam_old": ORBSLAM_OLD,
    "orbslam_new": ORBSLAM_NEW,
    "orbslam_rectified": ORBSLAM_RECTIFIED,
    "middlebury": MIDDLEBURY,
}
