"""Points of an image without PyTorch and sips_lit: sips-export checkpoint=sips-tiny format=onnx points=true

python detect_points.py sips-tiny-points.onnx image.png points.csv
"""

import sys

import cv2
import numpy as np
import onnxruntime

model, source, target = sys.argv[1:]
image = cv2.imread(source, cv2.IMREAD_GRAYSCALE)
if image is None:
    sys.exit(f"{source} is no image that OpenCV reads")
session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
keypoints, scores, count = session.run(
    ["keypoints", "scores", "count"], {"image": image[None, None].astype(np.float32)}
)
n = count[0]
points = np.column_stack([keypoints[0, :n], scores[0, :n]])
np.savetxt(target, points, "%.4f", ",", header="x,y,probability", comments="")
print(f"{n} points in {target}")
